"""The accounts the soil keeps of soil that is not terrain [mm^3 bank].

Every figure is counted where it is said to be: in flight from the conversion rows themselves,
pending and particles as each machine reports them, absent from the last report of a machine that
left, outside from the rows that said so. Nothing is found by subtraction, so that soil lost
anywhere shows as an imbalance.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, RowRange
from msg_bridge.contract.rows import (
    CONVERSION,
    ConversionKind,
    Rows,
    join_rows,
    machine_ids_in,
    rows_of_machine,
)

__all__ = ["SoilAccounts", "signed_volume"]

_SIGNS = np.array([1, -1, -1, 0], dtype=np.int64)
"""What a row's volume counts in flight, by its Kind."""


def signed_volume(conversions: Rows) -> int:
    """What these rows put in flight: excavated soil +, deposited and outside soil -."""
    return int(np.dot(_SIGNS[conversions["kind"]], conversions["volume_mm3"]))


class _InFlightRows(NamedTuple):
    """Rows of one source that were published together.

    Attributes:
        numbers: theirs among all conversion rows, ascending.
        rows: CONVERSION rows.
        volume: signed.
    """

    numbers: NDArray[np.int64]
    rows: Rows
    volume: int

    def through(self, number: int) -> int:
        """How many of them are numbered up to and with `number`."""
        return int(np.searchsorted(self.numbers, number, side="right"))

    def select(self, begin: int, end: int | None = None) -> _InFlightRows:
        """Some of them."""
        rows = self.rows[begin:end]
        return _InFlightRows(self.numbers[begin:end], rows, signed_volume(rows))


class _MachineAccount:
    """One source: what it last reported, and the rows it has not acknowledged.

    Attributes:
        present: whether it takes part.
        pending, particles: as last reported.
        applied: last conversion row those figures contain.
        floor: last conversion row it does not need from the stream to all.
        abandoned: what former lives held that can no longer come back.
    """

    def __init__(self) -> None:
        self.is_joined = False
        self.pending = 0
        self.particles = 0
        self.applied = 0
        self.last_row_not_needed = 0
        self.forfeited = 0
        self._in_flight_rows: deque[_InFlightRows] = deque()  # in order, none without rows

    @property
    def total(self) -> int:
        """All it last reported."""
        return self.pending + self.particles

    @property
    def in_flight(self) -> int:
        """Signed volume of the rows it has not acknowledged."""
        return sum(flight.volume for flight in self._in_flight_rows)

    @property
    def volume_left_behind(self) -> int:
        """All that lives of it that are over held, rows never acknowledged included."""
        return self.forfeited + self.total + self.in_flight

    @property
    def backlog(self) -> Rows:
        """The rows it has not acknowledged, in order."""
        return join_rows([flight.rows for flight in self._in_flight_rows], CONVERSION)

    def add_in_flight(self, numbers: NDArray[np.int64], rows: Rows) -> None:
        """Put rows in flight."""
        self._in_flight_rows.append(_InFlightRows(numbers, rows, signed_volume(rows)))

    def volume_up_to(self, through: int) -> int:
        """Signed volume of its rows in flight up to number `through`."""
        return sum(
            flight.select(0, flight.through(through)).volume for flight in self._in_flight_rows
        )

    def update_totals(self, pending: int, particles: int, through: int) -> None:
        """Take its figures as of conversion row `through`."""
        self.pending, self.particles = pending, particles
        self.applied = through
        self.last_row_not_needed = max(self.last_row_not_needed, through)
        while self._in_flight_rows and self._in_flight_rows[0].numbers[0] <= through:
            flight = self._in_flight_rows.popleft()
            applied = flight.through(through)
            if applied < flight.rows.size:
                self._in_flight_rows.appendleft(flight.select(applied))

    def forfeit(self) -> None:
        """Begin anew: what it held, and rows it will never apply, stay where they were lost."""
        self.forfeited += self.total + self.in_flight
        self.pending = self.particles = 0
        self._in_flight_rows.clear()

    def release(self) -> int:
        """Hand over all of it; nothing is left."""
        self.forfeit()
        volume, self.forfeited = self.forfeited, 0
        return volume


class SoilAccounts:
    """What was published, reported and left behind, by source."""

    def __init__(self) -> None:
        self._machines: dict[int, _MachineAccount] = {}
        self._released: dict[int, int] = {}  # handed over, not answered yet
        self._outside = 0
        self._start: int | None = None

    @property
    def last_row_acknowledged_by_all(self) -> int:
        """Last conversion row that every source taking part has applied; none: all of them."""
        is_joined = [a.last_row_not_needed for a in self._machines.values() if a.is_joined]
        return min(is_joined, default=2**63 - 1)

    def in_flight(self, machine_id: int) -> int:
        """Signed volume of rows a source has not acknowledged [mm^3]."""
        return self._machines[machine_id].in_flight

    def backlog(self, machine_id: int) -> Rows:
        """CONVERSION rows a source has not acknowledged, in order."""
        return self._machines[machine_id].backlog

    @property
    def absent(self) -> tuple[int, ...]:
        """Sources that take no part and have left soil behind, in order."""
        return tuple(
            n for n, a in sorted(self._machines.items()) if not a.is_joined and a.volume_left_behind
        )

    def check(self, conversions: Rows) -> None:
        """Refuse rows of a source that takes no part: nobody would ever acknowledge them.

        What was released needs no acknowledgement, but must be answered as a whole.

        Raises:
            ExchangeError: naming the source.
        """
        for machine_id, released in self._released.items():
            put_down = -signed_volume(rows_of_machine(conversions, machine_id))
            if put_down != released:
                raise ExchangeError(
                    f"{released} mm^3 of machine {machine_id} were released, but conversion rows put"
                    f" {put_down} mm^3 down"
                )
        for machine_id in machine_ids_in(conversions):
            account = self._machines.get(machine_id)
            if machine_id not in self._released and (account is None or not account.is_joined):
                raise ExchangeError(
                    f"there are conversion rows for {machine_id}, which has not joined"
                )

    def add_in_flight(self, span: RowRange, conversions: Rows) -> None:
        """Put published rows in flight, and count what left the map."""
        if conversions.size:
            outside = conversions["kind"] == ConversionKind.OUTSIDE
            self._outside += int(conversions["volume_mm3"][outside].sum(dtype=np.int64))
            numbers = np.arange(span.first, span.first + span.count, dtype=np.int64)
            sources = machine_ids_in(conversions)
            for machine_id in sources:
                if machine_id not in self._released:
                    own = (
                        conversions["machine_id"] == machine_id if len(sources) > 1 else slice(None)
                    )
                    self._machines[machine_id].add_in_flight(numbers[own], conversions[own])
        self._released.clear()

    def update_totals(self, header: MachineHeader) -> None:
        """Take a source's totals as of the last conversion row it acknowledges."""
        self._machines[header.machine_id].update_totals(
            header.pending_mm3, header.particles_mm3, header.conversions_received
        )

    def join(self, machine_id: int, published: int) -> None:
        """Let a source in that holds nothing; what a former life of it held is abandoned.

        Args:
            source: its number.
            published: last conversion row published so far; it needs none of those.
        """
        account = self._machines.setdefault(machine_id, _MachineAccount())
        account.forfeit()
        account.is_joined = True
        account.applied = account.last_row_not_needed = published

    def rejoin(self, header: MachineHeader, published: int) -> None:
        """Let a source in again with what it held when it left.

        Raises:
            ExchangeError: it never left, or holds another volume than it should.
        """
        account = self._machines.get(header.machine_id)
        through = header.conversions_received
        if account is None:
            raise ExchangeError(f"machine {header.machine_id} comes back but was never here; join")
        expected = account.total + account.volume_up_to(through)
        if through < account.applied or header.soil_mm3 != expected:
            raise ExchangeError(
                f"machine {header.machine_id} comes back with {header.soil_mm3} mm^3 of soil, but it"
                f" left with {expected} mm^3; join empty, or start it from its last state"
            )
        account.update_totals(header.pending_mm3, header.particles_mm3, through)
        account.is_joined = True
        account.last_row_not_needed = published  # older rows it needs are sent as owed

    def release(self, machine_id: int) -> int:
        """What an absent source held [mm^3], to be put down by the next rows that are booked."""
        account = self._machines.get(machine_id)
        volume = 0 if account is None or account.is_joined else account.release()
        if volume:
            self._released[machine_id] = volume
        return volume

    def leave(self, machine_id: int) -> None:
        """Keep what a leaving source last reported as absent, and the rows it is owed."""
        self._machines[machine_id].is_joined = False

    def ledger(self, run_id: int, tick: int, terrain: int) -> Ledger:
        """The ledger of a tick; the first one sets the sum that must stay."""
        in_flight = pending = particles = absent = 0
        for account in self._machines.values():
            in_flight += account.in_flight
            absent += account.forfeited
            if account.is_joined:
                pending += account.pending
                particles += account.particles
            else:
                absent += account.total
        entries = (terrain, in_flight, pending, particles, absent, self._outside)
        if self._start is None:
            self._start = sum(entries)
        return Ledger(run_id, tick, *entries, self._start)

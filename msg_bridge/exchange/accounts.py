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
from msg_bridge.contract.rows import CONVERSION, Kind, Rows, join_rows, rows_of, sources_of

__all__ = ["Accounts", "signed_volume"]

_SIGNS = np.array([1, -1, -1, 0], dtype=np.int64)
"""What a row's volume counts in flight, by its Kind."""


def signed_volume(conversions: Rows) -> int:
    """What these rows put in flight: excavated soil +, deposited and outside soil -."""
    return int(np.dot(_SIGNS[conversions["kind"]], conversions["volume_mm3"]))


class _Flight(NamedTuple):
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

    def cut(self, begin: int, end: int | None = None) -> _Flight:
        """Some of them."""
        rows = self.rows[begin:end]
        return _Flight(self.numbers[begin:end], rows, signed_volume(rows))


class _Account:
    """One source: what it last reported, and the rows it has not acknowledged.

    Attributes:
        present: whether it takes part.
        pending, particles: as last reported.
        applied: last conversion row those figures contain.
        floor: last conversion row it does not need from the stream to all.
        abandoned: what former lives held that can no longer come back.
    """

    def __init__(self) -> None:
        self.present = False
        self.pending = 0
        self.particles = 0
        self.applied = 0
        self.floor = 0
        self.abandoned = 0
        self._flights: deque[_Flight] = deque()  # in order, none without rows

    @property
    def held(self) -> int:
        """All it last reported."""
        return self.pending + self.particles

    @property
    def in_flight(self) -> int:
        """Signed volume of the rows it has not acknowledged."""
        return sum(flight.volume for flight in self._flights)

    @property
    def left_behind(self) -> int:
        """All that lives of it that are over held, rows never acknowledged included."""
        return self.abandoned + self.held + self.in_flight

    @property
    def owed(self) -> Rows:
        """The rows it has not acknowledged, in order."""
        return join_rows([flight.rows for flight in self._flights], CONVERSION)

    def book(self, numbers: NDArray[np.int64], rows: Rows) -> None:
        """Put rows in flight."""
        self._flights.append(_Flight(numbers, rows, signed_volume(rows)))

    def volume_through(self, through: int) -> int:
        """Signed volume of its rows in flight up to number `through`."""
        return sum(flight.cut(0, flight.through(through)).volume for flight in self._flights)

    def report(self, pending: int, particles: int, through: int) -> None:
        """Take its figures as of conversion row `through`."""
        self.pending, self.particles = pending, particles
        self.applied = through
        self.floor = max(self.floor, through)
        while self._flights and self._flights[0].numbers[0] <= through:
            flight = self._flights.popleft()
            applied = flight.through(through)
            if applied < flight.rows.size:
                self._flights.appendleft(flight.cut(applied))

    def abandon(self) -> None:
        """Begin anew: what it held, and rows it will never apply, stay where they were lost."""
        self.abandoned += self.held + self.in_flight
        self.pending = self.particles = 0
        self._flights.clear()

    def release(self) -> int:
        """Hand over all of it; nothing is left."""
        self.abandon()
        volume, self.abandoned = self.abandoned, 0
        return volume


class Accounts:
    """What was published, reported and left behind, by source."""

    def __init__(self) -> None:
        self._sources: dict[int, _Account] = {}
        self._released: dict[int, int] = {}  # handed over, not answered yet
        self._outside = 0
        self._start: int | None = None

    @property
    def acknowledged_by_all(self) -> int:
        """Last conversion row that every source taking part has applied; none: all of them."""
        present = [a.floor for a in self._sources.values() if a.present]
        return min(present, default=2**63 - 1)

    def in_flight(self, source: int) -> int:
        """Signed volume of rows a source has not acknowledged [mm^3]."""
        return self._sources[source].in_flight

    def owed(self, source: int) -> Rows:
        """CONVERSION rows a source has not acknowledged, in order."""
        return self._sources[source].owed

    @property
    def absent(self) -> tuple[int, ...]:
        """Sources that take no part and have left soil behind, in order."""
        return tuple(n for n, a in sorted(self._sources.items()) if not a.present and a.left_behind)

    def check(self, conversions: Rows) -> None:
        """Refuse rows of a source that takes no part: nobody would ever acknowledge them.

        What was released needs no acknowledgement, but must be answered as a whole.

        Raises:
            ExchangeError: naming the source.
        """
        for source, released in self._released.items():
            put_down = -signed_volume(rows_of(conversions, source))
            if put_down != released:
                raise ExchangeError(
                    f"{released} mm^3 of machine {source} were released, but conversion rows put"
                    f" {put_down} mm^3 down"
                )
        for source in sources_of(conversions):
            account = self._sources.get(source)
            if source not in self._released and (account is None or not account.present):
                raise ExchangeError(f"there are conversion rows for {source}, which has not joined")

    def book(self, span: RowRange, conversions: Rows) -> None:
        """Put published rows in flight, and count what left the map."""
        if conversions.size:
            outside = conversions["kind"] == Kind.OUTSIDE
            self._outside += int(conversions["volume_mm3"][outside].sum(dtype=np.int64))
            numbers = np.arange(span.first, span.first + span.count, dtype=np.int64)
            sources = sources_of(conversions)
            for source in sources:
                if source not in self._released:
                    own = conversions["source"] == source if len(sources) > 1 else slice(None)
                    self._sources[source].book(numbers[own], conversions[own])
        self._released.clear()

    def report(self, header: MachineHeader) -> None:
        """Take a source's totals as of the last conversion row it acknowledges."""
        self._sources[header.source].report(
            header.pending_mm3, header.particles_mm3, header.conversions_received
        )

    def join(self, source: int, published: int) -> None:
        """Let a source in that holds nothing; what a former life of it held is abandoned.

        Args:
            source: its number.
            published: last conversion row published so far; it needs none of those.
        """
        account = self._sources.setdefault(source, _Account())
        account.abandon()
        account.present = True
        account.applied = account.floor = published

    def come_back(self, header: MachineHeader, published: int) -> None:
        """Let a source in again with what it held when it left.

        Raises:
            ExchangeError: it never left, or holds another volume than it should.
        """
        account = self._sources.get(header.source)
        through = header.conversions_received
        if account is None:
            raise ExchangeError(f"machine {header.source} comes back but was never here; join")
        expected = account.held + account.volume_through(through)
        if through < account.applied or header.held_mm3 != expected:
            raise ExchangeError(
                f"machine {header.source} comes back with {header.held_mm3} mm^3 of soil, but it"
                f" left with {expected} mm^3; join empty, or start it from its last state"
            )
        account.report(header.pending_mm3, header.particles_mm3, through)
        account.present = True
        account.floor = published  # older rows it needs are sent as owed

    def release(self, source: int) -> int:
        """What an absent source held [mm^3], to be put down by the next rows that are booked."""
        account = self._sources.get(source)
        volume = 0 if account is None or account.present else account.release()
        if volume:
            self._released[source] = volume
        return volume

    def leave(self, source: int) -> None:
        """Keep what a leaving source last reported as absent, and the rows it is owed."""
        self._sources[source].present = False

    def ledger(self, tick: int, terrain: int) -> Ledger:
        """The ledger of a tick; the first one sets the sum that must stay."""
        in_flight = pending = particles = absent = 0
        for account in self._sources.values():
            in_flight += account.in_flight
            absent += account.abandoned
            if account.present:
                pending += account.pending
                particles += account.particles
            else:
                absent += account.held
        entries = (terrain, in_flight, pending, particles, absent, self._outside)
        if self._start is None:
            self._start = sum(entries)
        return Ledger(tick, *entries, self._start)

"""The accounts of soil that is not terrain [mm^3 bank].

Every account is counted independently: in flight from the conversion rows, pending and particles as
each machine reports them, absent from the last report of a machine that left, outside from the
OUTSIDE rows. None is computed by subtraction, so that soil lost anywhere shows as an imbalance.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, RowRange
from msg_bridge.contract.rows import (
    CONVERSION,
    ENDED_SESSION,
    ConversionKind,
    Rows,
    join_rows,
    machine_ids_in,
    rows_of_machine,
)

__all__ = ["LedgerAccounts", "signed_volume"]

_SIGNS = np.array([1, -1, -1, 0], dtype=np.int64)
"""Sign of the volume of a row in flight, by its ConversionKind."""


def signed_volume(conversions: Rows) -> int:
    """Return the volume that rows put in flight [mm^3]: excavated +, deposited and outside -."""
    return int(np.dot(_SIGNS[conversions["kind"]], conversions["volume_mm3"]))


class _InFlightRows(NamedTuple):
    """Rows of one machine that were published in the same tick.

    Attributes:
        numbers: their numbers in the CONVERSION stream, ascending, shape (n,).
        rows: CONVERSION rows, shape (n,).
        volume: signed volume [mm^3].
    """

    numbers: NDArray[np.int64]
    rows: Rows
    volume: int

    def count_through(self, number: int) -> int:
        """Return how many rows have numbers up to and including `number`."""
        return int(np.searchsorted(self.numbers, number, side="right"))

    def select(self, begin: int, end: int | None = None) -> _InFlightRows:
        """Return the rows begin to end - 1."""
        rows = self.rows[begin:end]
        return _InFlightRows(self.numbers[begin:end], rows, signed_volume(rows))


class _MachineAccount:
    """Account of one machine: its last report, and the rows it has not acknowledged.

    Attributes:
        is_joined: whether it takes part.
        pending, particles: volumes of the last report [mm^3].
        applied: last conversion row included in that report.
        last_row_not_needed: last row of the CONVERSION stream that need not be kept for it.
        forfeited: soil of earlier sessions that the machine cannot return with [mm^3].
    """

    def __init__(self) -> None:
        self.is_joined = False
        self.pending = 0
        self.particles = 0
        self.applied = 0
        self.last_row_not_needed = 0
        self.forfeited = 0
        self._in_flight_rows: deque[_InFlightRows] = deque()  # ascending, none empty

    @property
    def total(self) -> int:
        """Volume of the last report [mm^3]."""
        return self.pending + self.particles

    @property
    def in_flight(self) -> int:
        """Signed volume of the rows not acknowledged [mm^3]."""
        return sum(flight.volume for flight in self._in_flight_rows)

    @property
    def volume_left_behind(self) -> int:
        """Soil of all its sessions, rows never acknowledged included [mm^3]."""
        return self.forfeited + self.total + self.in_flight

    @property
    def backlog(self) -> Rows:
        """The rows not acknowledged, in order."""
        return join_rows([flight.rows for flight in self._in_flight_rows], CONVERSION)

    @property
    def deposited_particles(self) -> NDArray[np.uint32]:
        """Ids of the particles deposited by rows that are not acknowledged, shape (n,)."""
        rows = self.backlog
        is_deposited = (rows["kind"] == ConversionKind.DEPOSIT) | (
            rows["kind"] == ConversionKind.OUTSIDE
        )
        ids: NDArray[np.uint32] = rows["particle_id"][is_deposited]
        return ids

    def add_in_flight(self, numbers: NDArray[np.int64], rows: Rows) -> None:
        """Add published rows."""
        self._in_flight_rows.append(_InFlightRows(numbers, rows, signed_volume(rows)))

    def volume_up_to(self, through: int) -> int:
        """Return the signed volume of the rows in flight up to number `through` [mm^3]."""
        return sum(
            flight.select(0, flight.count_through(through)).volume
            for flight in self._in_flight_rows
        )

    def update_totals(self, pending: int, particles: int, through: int) -> None:
        """Set the totals as of conversion row `through`, which acknowledges the rows up to it."""
        self.pending, self.particles = pending, particles
        self.applied = through
        self.last_row_not_needed = max(self.last_row_not_needed, through)
        while self._in_flight_rows and self._in_flight_rows[0].numbers[0] <= through:
            flight = self._in_flight_rows.popleft()
            applied = flight.count_through(through)
            if applied < flight.rows.size:
                self._in_flight_rows.appendleft(flight.select(applied))

    def forfeit(self) -> None:
        """Move its soil, and the rows it will never apply, to the forfeited soil."""
        self.forfeited += self.total + self.in_flight
        self.pending = self.particles = 0
        self._in_flight_rows.clear()

    def release(self) -> int:
        """Remove all of its soil; return the volume [mm^3]."""
        self.forfeit()
        return self.release_forfeited()

    def release_forfeited(self) -> int:
        """Remove the soil of its earlier sessions; return the volume [mm^3]."""
        volume, self.forfeited = self.forfeited, 0
        return volume


class LedgerAccounts:
    """Accounts of all machines, and the soil outside of the map."""

    def __init__(self) -> None:
        self._machines: dict[int, _MachineAccount] = {}
        # Volume released and not deposited yet, by the machine id of the rows that deposit it.
        self._released: dict[int, int] = {}
        self._outside = 0
        self._start: int | None = None

    @property
    def last_row_acknowledged_by_all(self) -> int:
        """Last conversion row that no joined machine needs; 2**63 - 1 if no machine is joined."""
        rows = [a.last_row_not_needed for a in self._machines.values() if a.is_joined]
        return min(rows, default=2**63 - 1)

    def in_flight(self, machine_id: int) -> int:
        """Return the signed volume of the rows that a machine has not acknowledged [mm^3]."""
        return self._machines[machine_id].in_flight

    def backlog(self, machine_id: int) -> Rows:
        """Return the CONVERSION rows that a machine has not acknowledged, in order."""
        return self._machines[machine_id].backlog

    @property
    def absent(self) -> tuple[int, ...]:
        """Ids of the machines that take no part and have left soil behind, ascending."""
        return tuple(
            n for n, a in sorted(self._machines.items()) if not a.is_joined and a.volume_left_behind
        )

    @property
    def forfeited(self) -> dict[int, int]:
        """Soil that joined machines left behind in earlier sessions [mm^3], by machine id."""
        return {
            n: a.forfeited
            for n, a in sorted(self._machines.items())
            if a.is_joined and a.forfeited > 0
        }

    def check(self, conversions: Rows) -> None:
        """Check that each row has a joined machine to acknowledge it.

        Released soil needs no acknowledgement, but must be deposited in full.

        Raises:
            ExchangeError: NOT_JOINED or RELEASE.
        """
        for machine_id, released in self._released.items():
            deposited = -signed_volume(rows_of_machine(conversions, machine_id))
            if deposited != released:
                raise ExchangeError(
                    f"{released} mm^3 were released, but conversion rows with machine id"
                    f" {machine_id} deposit {deposited} mm^3; deposit all of it",
                    ErrorCode.RELEASE,
                )
        for machine_id in machine_ids_in(conversions):
            account = self._machines.get(machine_id)
            if machine_id not in self._released and (account is None or not account.is_joined):
                raise ExchangeError(
                    f"there are conversion rows of machine {machine_id}, which has not joined",
                    ErrorCode.NOT_JOINED,
                )

    def add_in_flight(self, span: RowRange, conversions: Rows) -> None:
        """Add published rows to the rows in flight, and count the soil that left the map."""
        if conversions.size:
            outside = conversions["kind"] == ConversionKind.OUTSIDE
            self._outside += int(conversions["volume_mm3"][outside].sum(dtype=np.int64))
            numbers = np.arange(span.first, span.first + span.count, dtype=np.int64)
            machine_ids = machine_ids_in(conversions)
            for machine_id in machine_ids:
                if machine_id not in self._released:
                    own = (
                        conversions["machine_id"] == machine_id
                        if len(machine_ids) > 1
                        else slice(None)
                    )
                    self._machines[machine_id].add_in_flight(numbers[own], conversions[own])
        self._released.clear()

    def check_totals(self, header: MachineHeader) -> None:
        """Check that the soil a machine reports is what it was credited with.

        Args:
            header: a tick of a joined machine that was not processed before.

        Raises:
            ExchangeError: VOLUME_MISMATCH.
        """
        account = self._machines[header.machine_id]
        expected = account.total + account.volume_up_to(header.conversions_received)
        if header.soil_mm3 != expected:
            raise ExchangeError(
                f"machine {header.machine_id} reports {header.soil_mm3} mm^3 of soil at tick"
                f" {header.tick}; the conversion rows that it acknowledges give {expected} mm^3",
                ErrorCode.VOLUME_MISMATCH,
            )

    def check_deposit_requests(self, machine_id: int, deposit_requests: Rows) -> None:
        """Check that a machine holds the soil that it requests to deposit, and requests it once.

        Args:
            machine_id: a joined machine.
            deposit_requests: its DEPOSIT_REQUEST rows of a tick.

        Raises:
            ExchangeError: DEPOSIT_VOLUME.
        """
        if deposit_requests.size == 0:
            return
        account = self._machines[machine_id]
        requested = int(deposit_requests["volume_mm3"].sum(dtype=np.int64))
        available = account.total + account.in_flight
        if requested > available:
            raise ExchangeError(
                f"machine {machine_id} requests to deposit {requested} mm^3 of soil, and holds"
                f" {available} mm^3",
                ErrorCode.DEPOSIT_VOLUME,
            )
        ids = deposit_requests["particle_id"]
        is_repeated = np.unique(ids).size < ids.size
        if is_repeated or np.isin(ids, account.deposited_particles).any():
            raise ExchangeError(
                f"machine {machine_id} requests to deposit a particle twice",
                ErrorCode.DEPOSIT_VOLUME,
            )

    def update_totals(self, header: MachineHeader) -> None:
        """Set a machine's totals as of the last conversion row that it acknowledges."""
        self._machines[header.machine_id].update_totals(
            header.pending_mm3, header.particles_mm3, header.conversions_received
        )

    def join(self, machine_id: int, published: int) -> None:
        """Open the account of a machine without soil; the soil of earlier sessions is forfeited.

        Args:
            machine_id: its number.
            published: last conversion row published so far; it needs none of those.
        """
        account = self._machines.setdefault(machine_id, _MachineAccount())
        account.forfeit()
        account.is_joined = True
        account.applied = account.last_row_not_needed = published

    def rejoin(self, header: MachineHeader, published: int) -> None:
        """Open the account of a machine that holds the soil it left with.

        Args:
            header: its request.
            published: last conversion row published so far; of those it receives its backlog.

        Raises:
            ExchangeError: REJOIN_VOLUME: it never took part, or reports another volume.
        """
        account = self._machines.get(header.machine_id)
        through = header.conversions_received
        if account is None:
            raise ExchangeError(
                f"machine {header.machine_id} requests to rejoin but has never taken part; join",
                ErrorCode.REJOIN_VOLUME,
            )
        expected = account.total + account.volume_up_to(through)
        if through < account.applied or header.soil_mm3 != expected:
            raise ExchangeError(
                f"machine {header.machine_id} requests to rejoin with {header.soil_mm3} mm^3 of"
                f" soil, but it left with {expected} mm^3; join without soil, or restore its state",
                ErrorCode.REJOIN_VOLUME,
            )
        account.update_totals(header.pending_mm3, header.particles_mm3, through)
        account.is_joined = True
        account.last_row_not_needed = published  # it receives older ones as backlog

    def release(self, machine_id: int) -> int:
        """Take over the soil of an absent machine [mm^3]; the next rows must deposit it."""
        account = self._machines.get(machine_id)
        volume = 0 if account is None or account.is_joined else account.release()
        if volume:
            self._released[machine_id] = volume
        return volume

    def release_forfeited(self, machine_id: int) -> int:
        """Take over what a joined machine left behind in earlier sessions [mm^3].

        The next rows must deposit it with the machine id `ENDED_SESSION`.
        """
        account = self._machines.get(machine_id)
        volume = account.release_forfeited() if account is not None and account.is_joined else 0
        if volume:
            self._released[ENDED_SESSION] = self._released.get(ENDED_SESSION, 0) + volume
        return volume

    def leave(self, machine_id: int) -> None:
        """Close the account of a machine: its soil is absent, its unacknowledged rows are kept."""
        self._machines[machine_id].is_joined = False

    def ledger(self, run_id: int, tick: int, terrain: int) -> Ledger:
        """Return the ledger of a tick; the sum of the first one is the start.

        Args:
            run_id: number of the run.
            tick: the tick that ended.
            terrain: volume of the terrain [mm^3].
        """
        in_flight = pending = particles = absent = 0
        for account in self._machines.values():
            in_flight += account.in_flight
            absent += account.forfeited
            if account.is_joined:
                pending += account.pending
                particles += account.particles
            else:
                absent += account.total
        accounts = (terrain, in_flight, pending, particles, absent, self._outside)
        if self._start is None:
            self._start = sum(accounts)
        return Ledger(run_id, tick, *accounts, self._start)

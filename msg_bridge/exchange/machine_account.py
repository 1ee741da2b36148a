"""The account of one machine: soil that it reports, and rows in flight to it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.messages import MachineHeader
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows, join_rows

__all__ = ["MachineAccount", "signed_volume"]

_SIGNS = np.array([1, -1, -1, 0], dtype=np.int64)
"""Sign of the volume of a row in flight, by its ConversionKind."""


_DEPOSITED_KINDS = (int(ConversionKind.DEPOSIT), int(ConversionKind.OUTSIDE))
"""Kinds of rows whose particle exists no more."""


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
        if number >= self.numbers[-1]:  # the usual case
            return self.numbers.size
        return int(np.searchsorted(self.numbers, number, side="right"))

    def select(self, begin: int, end: int | None = None) -> _InFlightRows:
        """Return the rows begin to end - 1."""
        if begin == 0 and (end is None or end >= self.rows.size):
            return self
        rows = self.rows[begin:end]
        return _InFlightRows(self.numbers[begin:end], rows, signed_volume(rows))


class _Report(NamedTuple):
    """Report of a machine, and the rows that it had not acknowledged."""

    pending: int
    particles: int
    applied: int
    rows: tuple[_InFlightRows, ...]


class MachineAccount:
    """Account of a machine from a JOIN on: its last report, and the rows it has not acknowledged.

    A rejoin continues the account; the next JOIN of the machine opens another one.

    Attributes:
        number: number of the account in the run.
        is_joined: whether the machine takes part with it.
        pending, particles: volumes of the last report [mm^3].
        applied: last conversion row included in that report.
        last_row_not_needed: last row of the CONVERSION stream that need not be kept for it.
    """

    def __init__(self, number: int, published: int) -> None:
        """Open the account of a machine without soil that takes part from now on.

        Args:
            number: number of the account.
            published: last conversion row published so far; the machine needs none of those.
        """
        self.number = number
        self.is_joined = True
        self.pending = 0
        self.particles = 0
        self.applied = self.last_row_not_needed = published
        self._in_flight_rows: deque[_InFlightRows] = deque()  # ascending, none empty
        self._before_rejoin: _Report | None = None  # until a tick of the session is processed

    @property
    def total(self) -> int:
        """Volume of the last report [mm^3]."""
        return self.pending + self.particles

    @property
    def in_flight(self) -> int:
        """Signed volume of the rows not acknowledged [mm^3]."""
        return sum([flight.volume for flight in self._in_flight_rows])

    @property
    def volume(self) -> int:
        """All of its soil, once the rows not acknowledged are applied [mm^3]."""
        return self.total + self.in_flight

    @property
    def is_empty(self) -> bool:
        """Whether it has neither soil nor rows that are not acknowledged."""
        return not self.total and not self._in_flight_rows

    @property
    def backlog(self) -> Rows:
        """The rows not acknowledged, in order."""
        return join_rows([flight.rows for flight in self._in_flight_rows], CONVERSION)

    @property
    def deposited_particles(self) -> set[int]:
        """Ids of the particles deposited by rows that are not acknowledged."""
        return {
            particle_id
            for flight in self._in_flight_rows
            for particle_id, kind in zip(
                flight.rows["particle_id"].tolist(), flight.rows["kind"].tolist(), strict=True
            )
            if kind in _DEPOSITED_KINDS
        }

    def add_in_flight(self, numbers: NDArray[np.int64], rows: Rows) -> None:
        """Add published rows."""
        self._in_flight_rows.append(_InFlightRows(numbers, rows, signed_volume(rows)))

    def volume_up_to(self, through: int) -> int:
        """Return the signed volume of the rows in flight up to number `through` [mm^3]."""
        volume = 0
        for flight in self._in_flight_rows:
            if flight.numbers[0] > through:
                break
            volume += flight.select(0, flight.count_through(through)).volume
        return volume

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

    def expected(self, through: int) -> int:
        """Return the soil that the machine holds after conversion row `through` [mm^3]."""
        return self.total + self.volume_up_to(through)

    def matches(self, header: MachineHeader) -> bool:
        """Return whether a machine that requests to rejoin holds the soil of this account."""
        through = header.conversions_received
        return through >= self.applied and header.soil_mm3 == self.expected(through)

    def rejoin(self, header: MachineHeader, published: int) -> None:
        """Continue the account with a request that matches it.

        Args:
            header: the request.
            published: last conversion row published so far.
        """
        self._before_rejoin = _Report(
            self.pending, self.particles, self.applied, tuple(self._in_flight_rows)
        )
        self.update_totals(header.pending_mm3, header.particles_mm3, header.conversions_received)
        self.is_joined = True
        self.last_row_not_needed = published  # it receives older ones as backlog

    def confirm_rejoin(self) -> None:
        """Make the last rejoin final: a tick of its session was processed."""
        self._before_rejoin = None

    def leave(self) -> None:
        """End the session. One without a processed tick does not change the account.

        A request to rejoin need not come from the machine, and may acknowledge more rows than the
        machine has applied.
        """
        self.is_joined = False
        if self._before_rejoin is not None:
            self.pending, self.particles, self.applied, rows = self._before_rejoin
            self._in_flight_rows = deque(rows)
            self._before_rejoin = None

    def release(self) -> int:
        """Remove all of its soil; return the volume [mm^3]."""
        volume = self.volume
        self.pending = self.particles = 0
        self._in_flight_rows.clear()
        return volume

"""The accounts the soil keeps of soil that is not terrain [mm^3 bank].

Every figure is counted where it is said to be: in flight from the conversion rows themselves,
pending and particles as each machine reports them, absent from the last report of a machine that
left, outside from the rows that said so. Nothing is found by subtraction, so that soil lost
anywhere shows as an imbalance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, RowRange
from msg_bridge.contract.rows import CONVERSION, Kind, Rows, empty_rows, join_rows, sources_of

__all__ = ["Accounts", "signed_volume"]


def signed_volume(conversions: Rows) -> int:
    """What these rows put in flight: excavated soil +, deposited and outside soil -."""
    volume = conversions["volume_mm3"].astype(np.int64)
    kind = conversions["kind"]
    out = int(volume[kind == Kind.EXCAVATE].sum())
    back = int(volume[(kind == Kind.DEPOSIT) | (kind == Kind.OUTSIDE)].sum())
    return out - back


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
        self._numbers = np.zeros(0, dtype=np.int64)
        self._rows = empty_rows(CONVERSION)

    @property
    def held(self) -> int:
        """All it last reported."""
        return self.pending + self.particles

    @property
    def in_flight(self) -> int:
        """Signed volume of the rows it has not acknowledged."""
        return signed_volume(self._rows)

    @property
    def left_behind(self) -> int:
        """All that lives of it that are over held, rows never acknowledged included."""
        return self.abandoned + self.held + self.in_flight

    @property
    def owed(self) -> Rows:
        """The rows it has not acknowledged, in order."""
        return self._rows

    def book(self, numbers: NDArray[np.int64], rows: Rows) -> None:
        """Put rows in flight."""
        self._numbers = np.concatenate([self._numbers, numbers])
        self._rows = join_rows([self._rows, rows], CONVERSION)

    def volume_through(self, through: int) -> int:
        """Signed volume of its rows in flight up to number `through`."""
        return signed_volume(self._rows[self._numbers <= through])

    def report(self, pending: int, particles: int, through: int) -> None:
        """Take its figures as of conversion row `through`."""
        self.pending, self.particles = pending, particles
        self.applied = through
        self.floor = max(self.floor, through)
        keep = self._numbers > through
        self._numbers, self._rows = self._numbers[keep], self._rows[keep]

    def abandon(self) -> None:
        """Begin anew: what it held, and rows it will never apply, stay where they were lost."""
        self.abandoned += self.held + self.in_flight
        self.pending = self.particles = 0
        self._numbers, self._rows = self._numbers[:0], self._rows[:0]

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
        for source in {*sources_of(conversions), *self._released}:
            rows = conversions[conversions["source"] == source]
            if source in self._released:
                if -signed_volume(rows) != self._released[source]:
                    raise ExchangeError(
                        f"{self._released[source]} mm^3 of machine {source} were released, but"
                        f" conversion rows put {-signed_volume(rows)} mm^3 down"
                    )
            elif source not in self._sources or not self._sources[source].present:
                raise ExchangeError(f"there are conversion rows for {source}, which has not joined")

    def book(self, span: RowRange, conversions: Rows) -> None:
        """Put published rows in flight, and count what left the map."""
        outside = conversions["kind"] == Kind.OUTSIDE
        self._outside += int(conversions["volume_mm3"][outside].astype(np.int64).sum())
        numbers = np.arange(span.first, span.first + span.count, dtype=np.int64)
        for source in sources_of(conversions):
            if source not in self._released:
                own = conversions["source"] == source
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
        accounts = self._sources.values()
        entries = {
            "terrain": terrain,
            "in_flight": sum(a.in_flight for a in accounts),
            "pending": sum(a.pending for a in accounts if a.present),
            "particles": sum(a.particles for a in accounts if a.present),
            "absent": sum(a.abandoned + (0 if a.present else a.held) for a in accounts),
            "outside": self._outside,
        }
        if self._start is None:
            self._start = sum(entries.values())
        return Ledger(tick=tick, start=self._start, **entries)

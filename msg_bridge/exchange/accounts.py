"""The accounts the soil keeps of soil that is not terrain [mm^3 bank].

Every figure is counted where it is said to be: in flight from the conversion rows themselves,
pending and particles as each machine reports them, absent from the last report of a machine that
left, outside from the rows that said so. Nothing is found by subtraction, so that soil lost
anywhere shows as an imbalance.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.rows import CONVERSION, Kind, Rows, empty_rows

__all__ = ["Accounts", "signed_volume"]


def signed_volume(conversions: Rows) -> int:
    """What these rows put in flight: excavated soil +, deposited and outside soil -."""
    volume = conversions["volume_mm3"].astype(np.int64)
    kind = conversions["kind"]
    out = int(volume[kind == Kind.EXCAVATE].sum())
    back = int(volume[(kind == Kind.DEPOSIT) | (kind == Kind.OUTSIDE)].sum())
    return out - back


class Accounts:
    """What was published, reported and left behind."""

    def __init__(self) -> None:
        self._unacknowledged = empty_rows(CONVERSION)
        self._acknowledged: dict[int, int] = {}
        self._pending: dict[int, int] = {}
        self._particles: dict[int, int] = {}
        self._absent: dict[int, int] = {}
        self._outside = 0
        self._start: int | None = None

    @property
    def acknowledged_by_all(self) -> int:
        """Last conversion row that no source, present or owed rows, still needs."""
        last = int(self._unacknowledged["seq"][-1]) if self._unacknowledged.size else 2**63 - 1
        owed = self._unacknowledged["seq"]
        floor = min(self._acknowledged.values(), default=last)
        return min(floor, int(owed[0]) - 1) if owed.size else floor

    def book(self, conversions: Rows) -> None:
        """Put published rows in flight, and count what left the map."""
        outside = conversions["kind"] == Kind.OUTSIDE
        self._outside += int(conversions["volume_mm3"][outside].astype(np.int64).sum())
        self._unacknowledged = np.concatenate([self._unacknowledged, conversions])

    def report(self, source: int, *, pending: int, particles: int, acknowledged: int) -> None:
        """Take a source's totals as of the last conversion row it acknowledges."""
        self._pending[source] = pending
        self._particles[source] = particles
        self._acknowledged[source] = acknowledged
        rows = self._unacknowledged
        done = (rows["source"] == source) & (rows["seq"] <= acknowledged)
        self._unacknowledged = rows[~done]

    def join(self, source: int, held: int, *, acknowledged: int) -> None:
        """Let a source in with the `held` volume it had when it left, or with nothing.

        Raises:
            ExchangeError: it holds soil that nobody misses.
        """
        absent = self._absent.get(source, 0)
        if held not in (0, absent):
            raise ExchangeError(
                f"machine {source} joins with {held} mm^3 of soil but left {absent} mm^3;"
                " start it empty or from its last state"
            )
        if held:
            self._absent[source] = 0
            self._particles[source] = held
            self._acknowledged[source] = acknowledged
        else:
            # It starts anew: what it held, and rows it will never apply, stay absent.
            rows = self._unacknowledged
            own = rows["source"] == source
            self._absent[source] = absent + signed_volume(rows[own])
            self._unacknowledged = rows[~own]
            self._acknowledged.pop(source, None)

    def leave(self, source: int) -> None:
        """Keep what a leaving source last reported as absent."""
        held = self._pending.pop(source) + self._particles.pop(source)
        self._absent[source] = self._absent.get(source, 0) + held
        if not held:
            # One that left with soil may come back for every row since; others need none.
            del self._acknowledged[source]

    def ledger(self, tick: int, terrain: int) -> Ledger:
        """The ledger of a tick; the first one sets the sum that must stay."""
        entries = {
            "terrain": terrain,
            "in_flight": signed_volume(self._unacknowledged),
            "pending": sum(self._pending.values()),
            "particles": sum(self._particles.values()),
            "absent": sum(self._absent.values()),
            "outside": self._outside,
        }
        if self._start is None:
            self._start = sum(entries.values())
        return Ledger(tick=tick, start=self._start, **entries)

"""Moment: what several topics told of one tick, gathered until it is whole.

Topics arrive in any order, and only together do they make a view. In lockstep every moment is
answered, and is exact, though soil and machine may have gone on meanwhile. In real time only the
newest is; the terrain may be newer, or a tick or two older, since machines are ahead of the soil.
"""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.ledger import Ledger

__all__ = ["SampleSynchronizer", "SyncedSample"]

_MAX_PENDING_TICKS = 100
"""Ticks kept at most while the rest of a moment has not come."""


@dataclass(frozen=True)
class SyncedSample:
    """What was told of the end of one tick.

    Attributes:
        tick: its number.
        joints: angles [rad].
        base: pose and motion of the base.
        payload: soil in the bucket.
        ledger: where the soil is, of this tick or a later one.
    """

    tick: int
    joints: ArrayLike
    base: BaseState
    payload: PayloadState
    ledger: Ledger


@dataclass
class _PartialSample:
    """What the machine told of a tick so far."""

    joints: ArrayLike | None = None
    base: BaseState | None = None
    payload: PayloadState | None = None

    @property
    def is_complete(self) -> bool:
        return None not in (self.base, self.payload) and self.joints is not None


class SampleSynchronizer:
    """Gives each whole moment once, in order."""

    def __init__(self, *, every_tick: bool) -> None:
        """
        Args:
            every: give every moment, with the first ledger that is not older, once the terrain is
                not older either; else the newest, with the newest of both.
        """
        self._every_tick = every_tick
        self._partial_samples: dict[int, _PartialSample] = {}
        self._ledgers: list[Ledger] = []
        self._last_tick = -1

    def add_joints(self, tick: int, angles: ArrayLike) -> None:
        """Take the joint angles at the end of a tick [rad]."""
        self._partial_sample(tick).joints = angles

    def add_base(self, tick: int, base: BaseState) -> None:
        """Take the base's pose at the end of a tick."""
        self._partial_sample(tick).base = base

    def add_payload(self, tick: int, payload: PayloadState) -> None:
        """Take the load at the end of a tick."""
        self._partial_sample(tick).payload = payload

    def add_ledger(self, ledger: Ledger) -> None:
        """Take the ledger."""
        self._ledgers = (
            [*self._ledgers[-_MAX_PENDING_TICKS:], ledger] if self._every_tick else [ledger]
        )

    @property
    def next_tick(self) -> int | None:
        """Tick of the moment that is to be given next, as far as the machine has told it."""
        is_complete = (tick for tick, state in self._partial_samples.items() if state.is_complete)
        return (
            min(is_complete, default=None) if self._every_tick else max(is_complete, default=None)
        )

    def pop_next(self, terrain_tick: int) -> SyncedSample | None:
        """The next moment, if it is whole; where every one counts, if the terrain is not older.

        Args:
            terrain_tick: the tick whose surface is known; -1 for none.
        """
        tick = self.next_tick
        if tick is None or terrain_tick < (tick if self._every_tick else 0):
            return None
        since = tick if self._every_tick else 0
        ledger = next((each for each in self._ledgers if each.tick >= since), None)
        if ledger is None:
            return None
        state = self._partial_samples[tick]
        assert state.joints is not None
        assert state.base is not None
        assert state.payload is not None
        self._last_tick = tick
        self._partial_samples = {
            each: state for each, state in self._partial_samples.items() if each > tick
        }
        self._ledgers = [each for each in self._ledgers if each.tick >= tick]
        return SyncedSample(tick, state.joints, state.base, state.payload, ledger)

    def _partial_sample(self, tick: int) -> _PartialSample:
        if tick <= self._last_tick:
            return _PartialSample()  # one that is kept nowhere
        if len(self._partial_samples) > _MAX_PENDING_TICKS:
            del self._partial_samples[min(self._partial_samples)]
        return self._partial_samples.setdefault(tick, _PartialSample())

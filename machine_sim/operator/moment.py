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

__all__ = ["Moment", "MomentGatherer"]

_MOST_KEPT = 100
"""Ticks kept at most while the rest of a moment has not come."""


@dataclass(frozen=True)
class Moment:
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
class _State:
    """What the machine told of a tick so far."""

    joints: ArrayLike | None = None
    base: BaseState | None = None
    payload: PayloadState | None = None

    @property
    def whole(self) -> bool:
        return None not in (self.base, self.payload) and self.joints is not None


class MomentGatherer:
    """Gives each whole moment once, in order."""

    def __init__(self, *, every: bool) -> None:
        """
        Args:
            every: give every moment, with the first ledger that is not older, once the terrain is
                not older either; else the newest, with the newest of both.
        """
        self._every = every
        self._states: dict[int, _State] = {}
        self._ledgers: list[Ledger] = []
        self._given = -1

    def joints(self, tick: int, angles: ArrayLike) -> None:
        """Take the joint angles at the end of a tick [rad]."""
        self._state(tick).joints = angles

    def base(self, tick: int, base: BaseState) -> None:
        """Take the base's pose at the end of a tick."""
        self._state(tick).base = base

    def payload(self, tick: int, payload: PayloadState) -> None:
        """Take the load at the end of a tick."""
        self._state(tick).payload = payload

    def ledger(self, ledger: Ledger) -> None:
        """Take the ledger."""
        self._ledgers = [*self._ledgers[-_MOST_KEPT:], ledger] if self._every else [ledger]

    @property
    def next_tick(self) -> int | None:
        """Tick of the moment that is to be given next, as far as the machine has told it."""
        whole = (tick for tick, state in self._states.items() if state.whole)
        return min(whole, default=None) if self._every else max(whole, default=None)

    def take(self, terrain_tick: int) -> Moment | None:
        """The next moment, if it is whole; where every one counts, if the terrain is not older.

        Args:
            terrain_tick: the tick whose surface is known; -1 for none.
        """
        tick = self.next_tick
        if tick is None or terrain_tick < (tick if self._every else 0):
            return None
        since = tick if self._every else 0
        ledger = next((each for each in self._ledgers if each.tick >= since), None)
        if ledger is None:
            return None
        state = self._states[tick]
        assert state.joints is not None
        assert state.base is not None
        assert state.payload is not None
        self._given = tick
        self._states = {each: state for each, state in self._states.items() if each > tick}
        self._ledgers = [each for each in self._ledgers if each.tick >= tick]
        return Moment(tick, state.joints, state.base, state.payload, ledger)

    def _state(self, tick: int) -> _State:
        if tick <= self._given:
            return _State()  # one that is kept nowhere
        if len(self._states) > _MOST_KEPT:
            del self._states[min(self._states)]
        return self._states.setdefault(tick, _State())

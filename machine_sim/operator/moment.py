"""Moment: what several topics told of one tick, gathered until it is whole.

Topics arrive in any order, and only together do they make a view. In lockstep nothing goes on
before the answer to it, so that the moment is exact; in real time the terrain may be newer.
"""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.ledger import Ledger

__all__ = ["Moment", "MomentGatherer"]


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


class MomentGatherer:
    """Keeps the newest of each topic, and gives each whole moment once, the newest first."""

    def __init__(self) -> None:
        self._joints: tuple[int, ArrayLike] | None = None
        self._base: tuple[int, BaseState] | None = None
        self._payload: tuple[int, PayloadState] | None = None
        self._ledger: Ledger | None = None
        self._given = -1

    def joints(self, tick: int, angles: ArrayLike) -> None:
        """Take the joint angles at the end of a tick [rad]."""
        self._joints = (tick, angles)

    def base(self, tick: int, base: BaseState) -> None:
        """Take the base's pose at the end of a tick."""
        self._base = (tick, base)

    def payload(self, tick: int, payload: PayloadState) -> None:
        """Take the load at the end of a tick."""
        self._payload = (tick, payload)

    def ledger(self, ledger: Ledger) -> None:
        """Take the ledger."""
        self._ledger = ledger

    def take(self, terrain_tick: int) -> Moment | None:
        """The newest moment, if it is whole, new, and the terrain is not older.

        Args:
            terrain_tick: the tick whose surface is known.
        """
        joints, base, payload, ledger = self._joints, self._base, self._payload, self._ledger
        if joints is None or base is None or payload is None or ledger is None:
            return None
        tick = joints[0]
        if tick <= self._given or base[0] != tick or payload[0] != tick:
            return None
        if ledger.tick < tick or terrain_tick < tick:
            return None
        self._given = tick
        return Moment(tick, joints[1], base[1], payload[1], ledger)

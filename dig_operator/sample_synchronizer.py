"""SampleSynchronizer: collects the messages of each tick until they are complete.

Messages arrive in any order, and only the complete set of a tick makes an observation. In lockstep
every sample is returned, with the terrain and the ledger of its own tick or later ones. In real
time only the newest is; its terrain may be newer, or a tick or two older, since machines run ahead
of the soil.
"""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.ledger import Ledger

__all__ = ["SampleSynchronizer", "SyncedSample"]

_MAX_PENDING_TICKS = 100
"""Maximum number of incomplete ticks that are kept; the oldest are dropped first."""


@dataclass(frozen=True)
class SyncedSample:
    """State of machine and soil at the end of one tick.

    Attributes:
        tick: number of the tick.
        joints: joint angles [rad].
        base: pose and motion of the base.
        payload: soil in the bucket.
        ledger: ledger of this tick, or of another one as `SampleSynchronizer` defines.
    """

    tick: int
    joints: ArrayLike
    base: BaseState
    payload: PayloadState
    ledger: Ledger


@dataclass
class _PartialSample:
    """Messages of the machine received for one tick."""

    joints: ArrayLike | None = None
    base: BaseState | None = None
    payload: PayloadState | None = None

    @property
    def is_complete(self) -> bool:
        return None not in (self.base, self.payload) and self.joints is not None


class SampleSynchronizer:
    """Returns each complete sample once, in the order of ticks."""

    def __init__(self, *, every_tick: bool) -> None:
        """
        Args:
            every_tick: return every sample, with the first ledger that is not older, once the
                terrain is not older either; otherwise only the newest sample, with the newest
                ledger and terrain.
        """
        self._every_tick = every_tick
        self._partial_samples: dict[int, _PartialSample] = {}
        self._ledgers: list[Ledger] = []
        self._last_tick = -1

    def add_joints(self, tick: int, angles: ArrayLike) -> None:
        """Add the joint angles at the end of a tick [rad]."""
        self._partial_sample(tick).joints = angles

    def add_base(self, tick: int, base: BaseState) -> None:
        """Add the pose of the base at the end of a tick."""
        self._partial_sample(tick).base = base

    def add_payload(self, tick: int, payload: PayloadState) -> None:
        """Add the payload at the end of a tick."""
        self._partial_sample(tick).payload = payload

    def add_ledger(self, ledger: Ledger) -> None:
        """Add the ledger of a tick."""
        self._ledgers = (
            [*self._ledgers[-_MAX_PENDING_TICKS:], ledger] if self._every_tick else [ledger]
        )

    @property
    def num_pending(self) -> int:
        """Number of samples and ledgers that are kept."""
        return len(self._partial_samples) + len(self._ledgers)

    @property
    def next_tick(self) -> int | None:
        """Tick of the next sample by the machine's messages; None if no tick is complete."""
        complete = (tick for tick, sample in self._partial_samples.items() if sample.is_complete)
        return min(complete, default=None) if self._every_tick else max(complete, default=None)

    def skip_to(self, tick: int) -> None:
        """Drop the samples of ticks before `tick`."""
        if tick > self._last_tick + 1:
            self._last_tick = tick - 1
            self._partial_samples = {t: s for t, s in self._partial_samples.items() if t >= tick}

    def pop_next(self, terrain_tick: int) -> SyncedSample | None:
        """Return the next sample and drop all older ones; None if it is not complete yet.

        Args:
            terrain_tick: tick of the known terrain; -1 for none.
        """
        tick = self.next_tick
        if tick is None:
            return None
        min_tick = tick if self._every_tick else 0  # of terrain and ledger
        ledger = next((each for each in self._ledgers if each.tick >= min_tick), None)
        if terrain_tick < min_tick or ledger is None:
            return None
        sample = self._partial_samples[tick]
        assert sample.joints is not None
        assert sample.base is not None
        assert sample.payload is not None
        self._last_tick = tick
        self._partial_samples = {t: s for t, s in self._partial_samples.items() if t > tick}
        self._ledgers = [each for each in self._ledgers if each.tick >= tick]
        return SyncedSample(tick, sample.joints, sample.base, sample.payload, ledger)

    def _partial_sample(self, tick: int) -> _PartialSample:
        if tick <= self._last_tick:
            return _PartialSample()  # too late: it is not kept
        if len(self._partial_samples) > _MAX_PENDING_TICKS:
            del self._partial_samples[min(self._partial_samples)]
        return self._partial_samples.setdefault(tick, _PartialSample())

"""What a replay found."""

from __future__ import annotations

from dataclasses import dataclass, field

from earthmoving_sim.replay.comparison import Difference

__all__ = ["ReplayResult"]


@dataclass
class ReplayResult:
    """What a replay found.

    Attributes:
        first_tick: tick of the state with which the replay began; 0: the begin of the run.
        last_tick: last tick of the soil that was computed.
        simulated_time: simulated time [s].
        wall_time: wall time of the replay [s], without its preparation.
        num_ledgers: number of equal ledgers.
        num_missing_ledgers: number of ticks whose ledger the recording lacks.
        num_hashes: number of equal state hashes by topic.
        difference: the first difference; None without one.
        ended_early: why the recording cannot be replayed further; empty if it was replayed to its
            end.
    """

    first_tick: int = 0
    last_tick: int = -1
    simulated_time: float = 0.0
    wall_time: float = 0.0
    num_ledgers: int = 0
    num_missing_ledgers: int = 0
    num_hashes: dict[str, int] = field(default_factory=dict)
    difference: Difference | None = None
    ended_early: str = ""

    @property
    def is_identical(self) -> bool:
        """Whether all ticks of the recording were replayed and compared without a difference."""
        is_complete = not self.ended_early and not self.num_missing_ledgers
        return self.difference is None and is_complete

    @property
    def num_ticks(self) -> int:
        """Number of ticks that were computed."""
        return max(self.last_tick - self.first_tick, 0)

"""LoadReport: the result of one load of a dumper."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LoadReport"]


@dataclass(frozen=True)
class LoadReport:
    """Result of one load.

    Attributes:
        number: number of the load, from 1.
        fill: fill of the bed when it left, as a fraction of the heaped capacity.
        hauled_volume: bank volume in the bed when it left [m^3].
        moved_volume: bank volume that it tipped [m^3].
        loading_time: time at the place of loading [s].
        duration: duration of the round [s].
    """

    number: int
    fill: float
    hauled_volume: float
    moved_volume: float
    loading_time: float
    duration: float

"""Sprockets and idlers of the tracks as links that rotate with the belts.

They are visual only: the physics of the tracks has its own wheels, or none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from machine_sim.machine.spec import MachineSpec, Vec3

__all__ = ["BeltOdometer", "TrackWheel", "track_wheels"]


class TrackWheel(NamedTuple):
    """A wheel and its continuous joint about y of the base, both of the same name.

    Attributes:
        link, joint: name of the link and of the joint between it and the base.
        side: 0 for the left track, 1 for the right.
        is_sprocket: whether it is the sprocket at the rear, not the idler at the front.
        origin: centre of the axle in the base frame [m].
        mimic: name of the joint whose angle it has, or None.
    """

    link: str
    joint: str
    side: int
    is_sprocket: bool
    origin: Vec3
    mimic: str | None


def track_wheels(spec: MachineSpec) -> tuple[TrackWheel, ...]:
    """Return sprocket and idler of the left track, then of the right one."""
    tracks = spec.tracks
    half, height = 0.5 * tracks.axle_distance, tracks.axle_height
    wheels = []
    for side, (name, y) in enumerate(
        (("left", 0.5 * tracks.gauge), ("right", -0.5 * tracks.gauge))
    ):
        sprocket, idler = f"{name}_sprocket", f"{name}_idler"
        wheels += [
            TrackWheel(sprocket, sprocket, side, True, (-half, y, height), None),
            TrackWheel(idler, idler, side, False, (half, y, height), sprocket),
        ]
    return tuple(wheels)


class BeltOdometer:
    """Total travel of both belts since the start of a run, as angles of the sprockets.

    The tracks count the travel modulo the length of a belt. The odometer adds up the differences,
    so the angles are continuous: they are not wrapped.

    Attributes:
        angles: angle of the left and the right sprocket [rad], positive driving forward.
    """

    def __init__(self, spec: MachineSpec) -> None:
        self.angles = (0.0, 0.0)
        self._length, self._radius = spec.tracks.belt_length, spec.tracks.sprocket_radius
        self._last: Sequence[float] = (0.0, 0.0)

    def update(self, travel: Sequence[float]) -> None:
        """Add the travel since the last call, less than half the length of a belt.

        Args:
            travel: travel of both belts modulo their length [m], shape (2,).
        """
        left, right = (
            angle + math.remainder(now - last, self._length) / self._radius
            for angle, now, last in zip(self.angles, travel, self._last, strict=True)
        )
        self.angles, self._last = (left, right), tuple(travel)

"""Visual shapes of a machine: shapes of its links, materials and points of view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from machine_sim.machine.rotations import rotation_from_rpy, rpy_from_rotation
from machine_sim.machine.shapes.materials import Material
from machine_sim.machine.shapes.shape import PlacedShape

__all__ = ["MachineShapes", "ViewPoint"]

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class ViewPoint:
    """A frame fixed to a link, where a camera or an effect is placed.

    Attributes:
        name: name of the frame.
        link: name of the link.
        position: its origin in the link frame [m].
        rpy: rotations about the fixed axes x, y, z of the link [rad]; a camera looks along x, with
            z up, and exhaust gas leaves along z.
    """

    name: str
    link: str
    position: Vec3
    rpy: Vec3

    @property
    def is_camera(self) -> bool:
        """Whether it is a camera: its name ends in `_camera`."""
        return self.name.endswith("_camera")

    def optical_frame(self) -> ViewPoint:
        """Return the frame of the images of a camera: x right, y down, z forward (REP 103)."""
        camera = rotation_from_rpy(self.rpy)
        forward, left, up = camera.T
        rpy = rpy_from_rotation(np.column_stack([-left, -up, forward]))
        return ViewPoint(f"{self.name}_optical", self.link, self.position, rpy)


@dataclass(frozen=True, eq=False)
class MachineShapes:
    """What a machine looks like; it has no effect on the physics.

    Attributes:
        links: shapes by the name of the link; a link without an entry shows its boxes.
        materials: materials of this machine by name, beside and before the shared ones.
        view_points: points of view.
    """

    links: Mapping[str, tuple[PlacedShape, ...]] = field(default_factory=dict)
    materials: Mapping[str, Material] = field(default_factory=dict)
    view_points: tuple[ViewPoint, ...] = ()

"""ObservedMachine: another machine as its public topics show it, and the space that it takes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineSpec
from machine_sim.machine.box import Box
from machine_sim.machine.forward_kinematics import link_frames
from machine_sim.machine.rotations import rotation_from_rpy
from machine_sim.machine.urdf import collision_boxes

__all__ = ["ObservedMachine"]

Array = NDArray[np.float64]

_POINT_SPACING = 0.25
"""Maximum distance of the points that represent the surface of a box [m]."""


@dataclass(frozen=True, eq=False)
class ObservedMachine:
    """Another machine at the end of a tick.

    Attributes:
        name: namespace of its topics.
        spec: its machine file.
        base_position: position of its base_link [m], map frame, shape (3,).
        base_rotation: rotation from its base_link to map, shape (3, 3).
        joints: angles of its joints [rad], shape (joints,).
        speed: speed of its base [m/s].
        fill: fill of its bucket or bed, as a fraction of the heaped capacity; 0 without one.
        bank_m3: bank volume of the soil in it [m^3].
        age: time since this state [s].
    """

    name: str
    spec: MachineSpec
    base_position: Array
    base_rotation: Array
    joints: Array
    speed: float = 0.0
    fill: float = 0.0
    bank_m3: float = 0.0
    age: float = 0.0

    @property
    def yaw(self) -> float:
        """Heading of the base [rad], counter-clockwise from the map's +x."""
        return math.atan2(self.base_rotation[1, 0], self.base_rotation[0, 0])

    @cached_property
    def link_frames(self) -> dict[str, tuple[Array, Array]]:
        """Rotation to map (3, 3) and origin [m], map frame, (3,), of each link by name."""
        return link_frames(self.spec, self.base_position, self.base_rotation, self.joints)

    @cached_property
    def points(self) -> Array:
        """Points on the surfaces of its collision boxes [m], map frame, shape (n, 3).

        They are at most 0.25 m apart, so that they can stand for the machine in distance checks.
        """
        frames = self.link_frames
        return np.concatenate(
            [
                local @ frames[link][0].T + frames[link][1]
                for link, local in _points_of_links(self.spec)
            ]
        )


@lru_cache(maxsize=16)
def _points_of_links(spec: MachineSpec) -> tuple[tuple[str, Array], ...]:
    """Return the points of each link that has boxes [m], link frame, shape (n, 3)."""
    return tuple(
        (link, np.concatenate([_box_points(box) for box in boxes]))
        for link in spec.links
        if (boxes := collision_boxes(spec, link))
    )


def _box_points(box: Box) -> Array:
    """Return points on the surface of a box [m], link frame, shape (n, 3)."""
    axes = [
        np.linspace(-0.5 * edge, 0.5 * edge, 1 + max(1, math.ceil(edge / _POINT_SPACING)))
        for edge in box.size
    ]
    points = np.array(list(_surface_points(axes)))
    rotation = rotation_from_rpy((0.0, box.pitch, 0.0))
    return np.asarray(points @ rotation.T + np.array(box.center), dtype=np.float64)


def _surface_points(axes: list[Array]) -> Iterator[tuple[float, float, float]]:
    x, y, z = np.meshgrid(*axes, indexing="ij")
    last = [len(axis) - 1 for axis in axes]
    i, j, k = np.indices(x.shape)
    is_surface = np.zeros(x.shape, dtype=bool)
    for index, end in zip((i, j, k), last, strict=True):
        is_surface |= (index == 0) | (index == end)
    yield from zip(
        x[is_surface].tolist(), y[is_surface].tolist(), z[is_surface].tolist(), strict=True
    )

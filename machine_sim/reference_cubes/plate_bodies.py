"""Tools in pybullet: each plate is a thin solid body; forces of the cubes on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.tools.plates import FRAME_N, closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import ANGULAR, TWIST_SIZE, Pose
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.machine.rotations import quaternion_from_matrix
from machine_sim.physics_engine import pybullet
from msg_bridge.kernels import kernel

__all__ = ["PlateBodies", "find_tunnelled"]

_THICKNESS = 0.02
"""Thickness of a plate, half of it on each side [m]: cubes tunnel through thinner ones."""
_BULLET_HULL_MARGIN = 0.001
"""Margin that Bullet adds to a convex hull [m]."""

_ON_PLATE, _NORMAL, _NORMAL_FORCE = 5, 7, 9
_FRICTION_FORCES, _FRICTION_DIRECTIONS = (10, 12), (11, 13)
"""Fields of a contact of `pybullet.getContactPoints`: position on the plate [m], direction of the
normal force and its size [N], sizes of the two friction forces [N] and their directions."""


class PlateBodies:
    """The plates of tools in a pybullet client.

    They are multibodies of mass 0. The contacts of Bullet use the velocity that is set on a
    multibody, so that friction moves the cubes; a static rigid body would slide under them.
    """

    def __init__(self, client: int) -> None:
        self._client = client
        self._plates: dict[int, list[int]] = {}

    def add(
        self, tool_id: int, tool: RigidTool, polygons: Sequence[ArrayLike], friction: float
    ) -> None:
        """Add the plates of a tool.

        Args:
            tool_id: an id that is not in use.
            tool: the tool.
            polygons: corners of its plates [m], tool frame.
            friction: coefficient that Bullet multiplies by that of a cube.
        """
        plates = []
        for polygon, frame in zip(polygons, tool.plates.frame, strict=True):
            corners, normal = np.asarray(polygon, dtype=np.float64), frame[FRAME_N : FRAME_N + 3]
            side = (0.5 * _THICKNESS - _BULLET_HULL_MARGIN) * normal
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                vertices=np.concatenate([corners + side, corners - side]).tolist(),
                physicsClientId=self._client,
            )
            plate: int = pybullet.createMultiBody(0.0, shape, physicsClientId=self._client)
            pybullet.changeDynamics(
                plate, -1, lateralFriction=friction, physicsClientId=self._client
            )
            plates.append(plate)
        self._plates[tool_id] = plates
        self.set_pose(tool_id, tool.start, np.zeros(TWIST_SIZE))

    def remove(self, tool_id: int) -> None:
        """Remove the plates of a tool."""
        for plate in self._plates.pop(tool_id):
            pybullet.removeBody(plate, self._client)

    def set_pose(self, tool_id: int, pose: Pose, twist: NDArray[np.float64]) -> None:
        """Set the pose of a tool at the start of a step, and its twist in the step."""
        origin, attitude = pose[1].tolist(), quaternion_from_matrix(pose[0])
        velocity, angular_velocity = twist[:ANGULAR].tolist(), twist[ANGULAR:].tolist()
        for plate in self._plates[tool_id]:
            pybullet.resetBasePositionAndOrientation(plate, origin, attitude, self._client)
            pybullet.resetBaseVelocity(plate, velocity, angular_velocity, self._client)

    def wrench(self, tool_id: int, origin: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the packed wrench on a tool in the last step, torque about `origin`, map axes.

        It is the sum of the normal and both friction forces of every contact.
        """
        contacts = [
            contact
            for plate in self._plates[tool_id]
            for contact in pybullet.getContactPoints(plate, physicsClientId=self._client)
        ]
        if not contacts:
            return np.zeros(TWIST_SIZE)
        sizes, directions = (_NORMAL_FORCE, *_FRICTION_FORCES), (_NORMAL, *_FRICTION_DIRECTIONS)
        position = np.array([contact[_ON_PLATE] for contact in contacts])
        size = np.array([[contact[k] for k in sizes] for contact in contacts])
        direction = np.array([[contact[k] for k in directions] for contact in contacts])
        force = np.einsum("ij,ijk->ik", size, direction)
        torque = np.cross(position - origin, force)
        return np.concatenate([force.sum(axis=0), torque.sum(axis=0)])


def find_tunnelled(
    tools: ToolSet, start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which centres went through a plate in this step, relative to the moving tool.

    Args:
        tools: before `ToolSet.end_step`.
        start, end: centres [m], map frame, shape (n, 3).
    """
    tunnelled = np.zeros(len(start), np.bool_)
    for tool in tools.tools:
        local_start = (start - tool.start[1]) @ tool.start[0]
        _mark_tunnelled(tool.plates, local_start, tool.to_local_frame(end), tunnelled)
    return tunnelled


@kernel
def _mark_tunnelled(plates, start, end, tunnelled):  # type: ignore[no-untyped-def]
    """Mark the paths from `start` to `end` [m], tool frame, that go through a plate."""
    for i in range(start.shape[0]):
        for k in range(plates.num_corners.size):
            a0, b0, h0 = plate_coordinates(plates, k, start[i, 0], start[i, 1], start[i, 2])
            a1, b1, h1 = plate_coordinates(plates, k, end[i, 0], end[i, 1], end[i, 2])
            if (h0 >= 0.0) == (h1 >= 0.0):
                continue
            fraction = h0 / (h0 - h1)
            _, _, inside = closest_in_polygon(
                plates, k, a0 + fraction * (a1 - a0), b0 + fraction * (b1 - b0)
            )
            tunnelled[i] |= inside

"""Tools in pybullet: every plate a thin solid body, and the forces of the cubes on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import Pose
from machine_sim.dem.tools.rigid_tool import RigidTool, ToolSet
from machine_sim.machine.rotations import quaternion_from_matrix
from machine_sim.physics_engine import pybullet
from msg_bridge.kernels import kernel

__all__ = ["PlateBodies", "find_tunnelled"]

_THICKNESS = 0.02
"""Of a plate, half of it on each side [m]: thin plates are passed through."""
_BULLET_HULL_MARGIN = 0.001
"""What Bullet puts around a convex hull [m]."""


class PlateBodies:
    """The plates of tools in a pybullet client.

    They are multibodies of mass 0: of these Bullet's contacts feel the velocity they are given,
    so that friction takes cubes along; static rigid bodies would slide under them.
    """

    def __init__(self, client: int) -> None:
        self._client = client
        self._plates: dict[int, list[int]] = {}

    def add(
        self, tool_id: int, tool: RigidTool, polygons: Sequence[ArrayLike], friction: float
    ) -> None:
        """Build a tool's plates.

        Args:
            tool_id: a new one.
            tool: the tool.
            polygons: its plates, corners [m], tool frame.
            friction: coefficient that Bullet multiplies by the cubes' own.
        """
        plates = []
        for polygon, frame in zip(polygons, tool.plates.frame, strict=True):
            corners, normal = np.asarray(polygon, dtype=np.float64), frame[9:12]
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
        self.set_pose(tool_id, tool.start, np.zeros(6))

    def remove(self, tool_id: int) -> None:
        """Take a tool's plates away."""
        for plate in self._plates.pop(tool_id):
            pybullet.removeBody(plate, self._client)

    def set_pose(self, tool_id: int, pose: Pose, twist: NDArray[np.float64]) -> None:
        """Put a tool where a step starts, with the velocity and angular velocity of the step."""
        place, attitude = pose[1].tolist(), quaternion_from_matrix(pose[0])
        velocity, angular_velocity = twist[:3].tolist(), twist[3:].tolist()
        for plate in self._plates[tool_id]:
            pybullet.resetBasePositionAndOrientation(plate, place, attitude, self._client)
            pybullet.resetBaseVelocity(plate, velocity, angular_velocity, self._client)

    def wrench(self, tool_id: int, origin: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force [N] on a tool and torque about `origin` [N m], map axes, in the last step.

        Sums the normal and both friction forces of every contact; shape (6,).
        """
        contacts = [
            contact
            for plate in self._plates[tool_id]
            for contact in pybullet.getContactPoints(plate, physicsClientId=self._client)
        ]
        if not contacts:
            return np.zeros(6)
        # Place on the tool; then force and direction of the push and of both frictions.
        at = np.array([contact[5] for contact in contacts])
        size = np.array([(contact[9], contact[10], contact[12]) for contact in contacts])
        directions = np.array([(contact[7], contact[11], contact[13]) for contact in contacts])
        force = np.einsum("ij,ijk->ik", size, directions)
        torque = np.cross(at - origin, force)
        return np.concatenate([force.sum(axis=0), torque.sum(axis=0)])


def find_tunnelled(
    tools: ToolSet, before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whose centre went through a plate in this step, as seen from the moving tool.

    Args:
        tools: before `ToolSet.end`.
        before, after: centres [m], map frame, shape (n, 3).
    """
    through = np.zeros(len(before), np.bool_)
    for tool in tools.tools:
        plates = tool.plates
        start = (before - tool.start[1]) @ tool.start[0]
        _mark_tunnelled(plates, start, tool.to_local_frame(after), through)
    return through


@kernel
def _mark_tunnelled(plates, start, end, through):  # type: ignore[no-untyped-def]
    """Mark whose way from `start` to `end` [m], tool frame, pierces a plate."""
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
            through[i] |= inside

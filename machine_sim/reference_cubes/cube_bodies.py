"""The cubes in pybullet: one rigid box per row of the particle state, in its order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleState
from machine_sim.physics_engine import pybullet

__all__ = ["CubeBodies", "bullet_friction"]

_HALF_EDGE_RESOLUTION = 1e-4
"""Resolution of half edges for collision [m]. Pybullet never frees a shape that was used, so cubes
must share a bounded number of them."""

_MAX_EXPECTED_DELTA_V = 1.0
"""Maximum change of velocity by contacts in a step that is expected again in the next [m/s]."""

_MAX_FRICTION = 2.0
"""Friction of a soil that stands vertically."""


def bullet_friction(repose_angle: float) -> float:
    """Return the coefficient for which two cubes have friction tan(repose angle [deg]).

    Bullet multiplies the coefficients of two bodies in contact.
    """
    return math.sqrt(min(math.tan(math.radians(min(repose_angle, 89.0))), _MAX_FRICTION))


class CubeBodies:
    """Boxes of a pybullet client.

    The particle state is authoritative: `write_to_bullet` gives pybullet what was changed there
    since the last `read_from_bullet`.

    Attributes:
        quaternion: attitudes x y z w, shape (n, 4).
        contact_delta_velocity, contact_delta_angular_velocity: changes of velocity [m/s] and of
            angular velocity [rad/s] by contacts in the last step, shape (n, 3); large ones, which
            are impacts, are scaled down.
    """

    def __init__(self, client: int) -> None:
        self.quaternion = np.zeros((0, 4))
        self.contact_delta_velocity = np.zeros((0, 3))
        self.contact_delta_angular_velocity = np.zeros((0, 3))
        self._client = client
        self._body_ids = np.zeros(0, np.int64)
        self._position = np.zeros((0, 3))
        self._velocity = np.zeros((0, 3))
        self._angular_velocity = np.zeros((0, 3), np.float32)
        self._shapes: dict[int, int] = {}

    def add(
        self,
        position: NDArray[np.float64],
        half_edge: NDArray[np.floating],
        mass: NDArray[np.floating],
        friction: NDArray[np.floating],
    ) -> None:
        """Append boxes at rest, aligned with the axes of the map as in the reference.

        Args:
            position: centres [m], shape (n, 3).
            half_edge: [m], shape (n,).
            mass: [kg], shape (n,).
            friction: coefficients of `bullet_friction`, shape (n,).
        """
        n = len(position)
        columns = (column.tolist() for column in (position, half_edge, mass, friction))
        body_ids = np.array([self._add_box(*box) for box in zip(*columns, strict=True)], np.int64)
        self._body_ids = np.concatenate([self._body_ids, body_ids])
        self._position = np.concatenate([self._position, position])
        self._velocity = np.concatenate([self._velocity, np.zeros((n, 3))])
        self._angular_velocity = np.concatenate(
            [self._angular_velocity, np.zeros((n, 3), np.float32)]
        )
        identity_attitude = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        self.quaternion = np.concatenate([self.quaternion, identity_attitude])
        self.contact_delta_velocity = np.concatenate(
            [self.contact_delta_velocity, np.zeros((n, 3))]
        )
        self.contact_delta_angular_velocity = np.concatenate(
            [self.contact_delta_angular_velocity, np.zeros((n, 3))]
        )

    def _add_box(
        self, position: Sequence[float], half_edge: float, mass: float, friction: float
    ) -> int:
        # As a rigid body, not as a multibody of one link: twice as fast.
        body: int = pybullet.createMultiBody(
            mass, self._shape(half_edge), -1, position, useMaximalCoordinates=1,
            physicsClientId=self._client,
        )  # fmt: skip
        pybullet.changeDynamics(
            body, -1, lateralFriction=friction, linearDamping=0.0, angularDamping=0.0,
            physicsClientId=self._client,
        )  # fmt: skip
        return body

    def remove(self, rows: NDArray[np.intp]) -> None:
        """Remove boxes; the others keep their order."""
        for body in self._body_ids[rows].tolist():
            pybullet.removeBody(body, self._client)
        self._body_ids = np.delete(self._body_ids, rows)
        self._position = np.delete(self._position, rows, axis=0)
        self._velocity = np.delete(self._velocity, rows, axis=0)
        self._angular_velocity = np.delete(self._angular_velocity, rows, axis=0)
        self.quaternion = np.delete(self.quaternion, rows, axis=0)
        self.contact_delta_velocity = np.delete(self.contact_delta_velocity, rows, axis=0)
        self.contact_delta_angular_velocity = np.delete(
            self.contact_delta_angular_velocity, rows, axis=0
        )

    def set_mass(self, rows: NDArray[np.intp], mass: NDArray[np.floating]) -> None:
        """Set the masses of boxes [kg]; a box of mass 0 does not move."""
        for body, body_mass in zip(self._body_ids[rows].tolist(), mass.tolist(), strict=True):
            pybullet.changeDynamics(body, -1, mass=body_mass, physicsClientId=self._client)

    def write_to_bullet(self, state: ParticleState) -> None:
        """Set position and motion of the boxes in pybullet where the state has changed."""
        is_moved = (state.position != self._position).any(axis=1)
        for k in np.flatnonzero(is_moved).tolist():
            pybullet.resetBasePositionAndOrientation(
                int(self._body_ids[k]), state.position[k].tolist(), self.quaternion[k].tolist(),
                physicsClientId=self._client,
            )  # fmt: skip
        # Setting the position of a body clears its velocity.
        is_changed = is_moved | (state.velocity != self._velocity).any(axis=1)
        is_changed |= (state.angular_velocity != self._angular_velocity).any(axis=1)
        rows = np.flatnonzero(is_changed)
        motion = zip(
            self._body_ids[rows].tolist(),
            state.velocity[rows].tolist(),
            state.angular_velocity[rows].tolist(),
            strict=True,
        )
        for body, velocity, angular_velocity in motion:
            pybullet.resetBaseVelocity(
                body, velocity, angular_velocity, physicsClientId=self._client
            )

    def read_from_bullet(self, state: ParticleState, gravity_delta_v: float) -> None:
        """Copy positions and motion from pybullet to the state after a step.

        Args:
            state: the cubes, with the velocities at the start of the step.
            gravity_delta_v: increase of the downward velocity by gravity in the step [m/s].
        """
        body_ids = self._body_ids.tolist()
        if not body_ids:
            return
        poses = [pybullet.getBasePositionAndOrientation(body, self._client) for body in body_ids]
        motion = np.array([pybullet.getBaseVelocity(body, self._client) for body in body_ids])
        self._position = np.array([position for position, _ in poses])
        self.quaternion = np.array([attitude for _, attitude in poses])
        self._velocity = motion[:, 0].copy()
        self._angular_velocity = motion[:, 1].astype(np.float32)
        delta = self._velocity - state.velocity + [0.0, 0.0, gravity_delta_v]
        angular_delta = (self._angular_velocity - state.angular_velocity).astype(np.float64)
        size = np.linalg.norm(delta, axis=1, keepdims=True)
        scale = np.minimum(_MAX_EXPECTED_DELTA_V / np.maximum(size, _MAX_EXPECTED_DELTA_V), 1.0)
        self.contact_delta_velocity = delta * scale
        self.contact_delta_angular_velocity = angular_delta * scale
        state.position[:], state.velocity[:] = self._position, self._velocity
        state.angular_velocity[:] = self._angular_velocity

    def _shape(self, half_edge: float) -> int:
        """Return the collision shape of a box, shared by boxes of about the same size."""
        steps = max(round(half_edge / _HALF_EDGE_RESOLUTION), 1)
        if steps not in self._shapes:
            self._shapes[steps] = pybullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=[steps * _HALF_EDGE_RESOLUTION] * 3,
                physicsClientId=self._client,
            )
        return self._shapes[steps]

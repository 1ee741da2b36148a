"""The cubes in pybullet: one rigid box per row of the store, in its order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleState
from machine_sim.physics_engine import pybullet

__all__ = ["CubeBodies", "bullet_friction"]

_HALF_EDGE_RESOLUTION = 1e-4
"""Half edges are rounded to this for collision [m]: pybullet never gives a used shape back, so
cubes must share a bounded number of them."""

_MAX_EXPECTED_DELTA_V = 1.0
"""Of what contacts do to a velocity in a step, as much as is expected again [m/s]."""

_MAX_FRICTION = 2.0
"""Friction of a soil that stands upright."""


def bullet_friction(repose_angle: float) -> float:
    """What to give to each of two cubes that shall have friction tan(repose angle [deg]).

    Bullet multiplies the coefficients of two bodies that touch.
    """
    return math.sqrt(min(math.tan(math.radians(min(repose_angle, 89.0))), _MAX_FRICTION))


class CubeBodies:
    """Boxes of a pybullet client.

    The store is what counts: `push` gives pybullet what was changed there since the last `pull`.

    Attributes:
        quaternion: attitudes x y z w, shape (n, 4).
        load, contact_delta_angular_velocity: velocity [m/s] and spin [rad/s] that contacts gave each in the last step,
            shape (n, 3); large ones, which are blows, made smaller.
    """

    def __init__(self, client: int) -> None:
        self.quaternion = np.zeros((0, 4))
        self._client = client
        self.contact_delta_velocity = np.zeros((0, 3))
        self.contact_delta_angular_velocity = np.zeros((0, 3))
        self._ids = np.zeros(0, np.int64)
        self._position = np.zeros((0, 3))
        self._velocity = np.zeros((0, 3))
        self._spin = np.zeros((0, 3), np.float32)
        self._shapes: dict[int, int] = {}

    def add(
        self,
        position: NDArray[np.float64],
        half: NDArray[np.floating],
        mass: NDArray[np.floating],
        friction: NDArray[np.floating],
    ) -> None:
        """Append boxes at rest, level with the map's axes as the reference makes them.

        Args:
            position: centres [m], shape (n, 3).
            half: half edges [m], shape (n,).
            mass: [kg], shape (n,).
            friction: coefficients of `bullet_friction`, shape (n,).
        """
        n = len(position)
        ids = np.zeros(n, np.int64)
        columns = (column.tolist() for column in (position, half, mass, friction))
        for k, (place, edge, weight, own) in enumerate(zip(*columns, strict=True)):
            # As rigid bodies, not as multibodies of one link: twice as fast.
            ids[k] = pybullet.createMultiBody(
                weight, self._shape(edge), -1, place, useMaximalCoordinates=1,
                physicsClientId=self._client,
            )  # fmt: skip
            pybullet.changeDynamics(
                int(ids[k]), -1, lateralFriction=own, linearDamping=0.0, angularDamping=0.0,
                physicsClientId=self._client,
            )  # fmt: skip
        self._ids = np.concatenate([self._ids, ids])
        self._position = np.concatenate([self._position, position])
        self._velocity = np.concatenate([self._velocity, np.zeros((n, 3))])
        self._spin = np.concatenate([self._spin, np.zeros((n, 3), np.float32)])
        identity_attitude = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        self.quaternion = np.concatenate([self.quaternion, identity_attitude])
        self.contact_delta_velocity = np.concatenate(
            [self.contact_delta_velocity, np.zeros((n, 3))]
        )
        self.contact_delta_angular_velocity = np.concatenate(
            [self.contact_delta_angular_velocity, np.zeros((n, 3))]
        )

    def remove(self, rows: NDArray[np.intp]) -> None:
        """Take boxes out; the others keep their order."""
        for body in self._ids[rows].tolist():
            pybullet.removeBody(body, self._client)
        self._ids = np.delete(self._ids, rows)
        self._position = np.delete(self._position, rows, axis=0)
        self._velocity = np.delete(self._velocity, rows, axis=0)
        self._spin = np.delete(self._spin, rows, axis=0)
        self.quaternion = np.delete(self.quaternion, rows, axis=0)
        self.contact_delta_velocity = np.delete(self.contact_delta_velocity, rows, axis=0)
        self.contact_delta_angular_velocity = np.delete(
            self.contact_delta_angular_velocity, rows, axis=0
        )

    def set_mass(self, rows: NDArray[np.intp], mass: NDArray[np.floating]) -> None:
        """Give boxes another mass [kg]; one without does not move."""
        for body, weight in zip(self._ids[rows].tolist(), mass.tolist(), strict=True):
            pybullet.changeDynamics(body, -1, mass=weight, physicsClientId=self._client)

    def write_to_bullet(self, state: ParticleState) -> None:
        """Let pybullet know where the store differs from what it said last."""
        moved = (state.position != self._position).any(axis=1)
        for k in np.flatnonzero(moved).tolist():
            pybullet.resetBasePositionAndOrientation(
                int(self._ids[k]), state.position[k].tolist(), self.quaternion[k].tolist(),
                physicsClientId=self._client,
            )  # fmt: skip
        # Moving a body stops it.
        pushed = moved | (state.velocity != self._velocity).any(axis=1)
        pushed |= (state.angular_velocity != self._spin).any(axis=1)
        rows = np.flatnonzero(pushed)
        motion = zip(
            self._ids[rows].tolist(),
            state.velocity[rows].tolist(),
            state.angular_velocity[rows].tolist(),
            strict=True,
        )
        for body, velocity, angular_velocity in motion:
            pybullet.resetBaseVelocity(
                body, velocity, angular_velocity, physicsClientId=self._client
            )

    def read_from_bullet(self, state: ParticleState, gravity_delta_v: float) -> None:
        """Take positions and motion over from pybullet after a step.

        Args:
            store: with the velocities the step began with.
            fall: what gravity adds to a downward velocity in the step [m/s].
        """
        ids = self._ids.tolist()
        if not ids:
            return
        poses = [pybullet.getBasePositionAndOrientation(body, self._client) for body in ids]
        motions = [pybullet.getBaseVelocity(body, self._client) for body in ids]
        place = np.array([(*at, *attitude) for at, attitude in poses])
        motion = np.array(motions)
        self._position, self.quaternion = place[:, :3].copy(), place[:, 3:].copy()
        self._velocity, self._spin = motion[:, 0].copy(), motion[:, 1].astype(np.float32)
        self.contact_delta_velocity = self._velocity - state.velocity + [0.0, 0.0, gravity_delta_v]
        self.contact_delta_angular_velocity = (self._spin - state.angular_velocity).astype(
            np.float64
        )
        size = np.linalg.norm(self.contact_delta_velocity, axis=1, keepdims=True)
        scale = np.minimum(_MAX_EXPECTED_DELTA_V / np.maximum(size, _MAX_EXPECTED_DELTA_V), 1.0)
        self.contact_delta_velocity *= scale
        self.contact_delta_angular_velocity *= scale
        state.position[:], state.velocity[:] = self._position, self._velocity
        state.angular_velocity[:] = self._spin

    def _shape(self, half: float) -> int:
        steps = max(round(half / _HALF_EDGE_RESOLUTION), 1)
        if steps not in self._shapes:
            self._shapes[steps] = pybullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=[steps * _HALF_EDGE_RESOLUTION] * 3,
                physicsClientId=self._client,
            )
        return self._shapes[steps]

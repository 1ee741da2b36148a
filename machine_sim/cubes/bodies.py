"""The cubes in pybullet: one rigid box per row of the store, in its order."""

from __future__ import annotations

import math

import numpy as np
import pybullet
from numpy.typing import NDArray

from machine_sim.particles.store import ParticleStore

__all__ = ["CubeBodies", "own_friction"]

_SHAPE_STEP = 1e-4
"""Half edges are rounded to this for collision [m]: pybullet never gives a used shape back, so
cubes must share a bounded number of them."""

_LARGEST_LOAD = 1.0
"""Of what contacts do to a velocity in a step, as much as is expected again [m/s]."""

_MOST_FRICTION = 2.0
"""Friction of a soil that stands upright."""


def own_friction(repose_angle: float) -> float:
    """What to give to each of two cubes that shall have friction tan(repose angle [deg]).

    Bullet multiplies the coefficients of two bodies that touch.
    """
    return math.sqrt(min(math.tan(math.radians(min(repose_angle, 89.0))), _MOST_FRICTION))


class CubeBodies:
    """Boxes of a pybullet client.

    The store is what counts: `push` gives pybullet what was changed there since the last `pull`.

    Attributes:
        quaternion: attitudes x y z w, shape (n, 4).
        load, load_spin: velocity [m/s] and spin [rad/s] that contacts gave each in the last step,
            shape (n, 3); large ones, which are blows, made smaller.
    """

    def __init__(self, client: int) -> None:
        self.quaternion = np.zeros((0, 4))
        self._client = client
        self.load = np.zeros((0, 3))
        self.load_spin = np.zeros((0, 3))
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
            friction: coefficients of `own_friction`, shape (n,).
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
        level = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        self.quaternion = np.concatenate([self.quaternion, level])
        self.load = np.concatenate([self.load, np.zeros((n, 3))])
        self.load_spin = np.concatenate([self.load_spin, np.zeros((n, 3))])

    def remove(self, rows: NDArray[np.intp]) -> None:
        """Take boxes out; the others keep their order."""
        for body in self._ids[rows].tolist():
            pybullet.removeBody(body, self._client)
        self._ids = np.delete(self._ids, rows)
        self._position = np.delete(self._position, rows, axis=0)
        self._velocity = np.delete(self._velocity, rows, axis=0)
        self._spin = np.delete(self._spin, rows, axis=0)
        self.quaternion = np.delete(self.quaternion, rows, axis=0)
        self.load = np.delete(self.load, rows, axis=0)
        self.load_spin = np.delete(self.load_spin, rows, axis=0)

    def weigh(self, rows: NDArray[np.intp], mass: NDArray[np.floating]) -> None:
        """Give boxes another mass [kg]; one without does not move."""
        for body, weight in zip(self._ids[rows].tolist(), mass.tolist(), strict=True):
            pybullet.changeDynamics(body, -1, mass=weight, physicsClientId=self._client)

    def push(self, store: ParticleStore) -> None:
        """Let pybullet know where the store differs from what it said last."""
        moved = (store.position != self._position).any(axis=1)
        for k in np.flatnonzero(moved).tolist():
            pybullet.resetBasePositionAndOrientation(
                int(self._ids[k]), store.position[k].tolist(), self.quaternion[k].tolist(),
                physicsClientId=self._client,
            )  # fmt: skip
        # Moving a body stops it.
        pushed = moved | (store.velocity != self._velocity).any(axis=1)
        pushed |= (store.spin != self._spin).any(axis=1)
        rows = np.flatnonzero(pushed)
        motion = zip(
            self._ids[rows].tolist(),
            store.velocity[rows].tolist(),
            store.spin[rows].tolist(),
            strict=True,
        )
        for body, velocity, spin in motion:
            pybullet.resetBaseVelocity(body, velocity, spin, physicsClientId=self._client)

    def pull(self, store: ParticleStore, fall: float) -> None:
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
        self.load = self._velocity - store.velocity + [0.0, 0.0, fall]
        self.load_spin = (self._spin - store.spin).astype(np.float64)
        size = np.linalg.norm(self.load, axis=1, keepdims=True)
        share = np.minimum(_LARGEST_LOAD / np.maximum(size, _LARGEST_LOAD), 1.0)
        self.load *= share
        self.load_spin *= share
        store.position[:], store.velocity[:] = self._position, self._velocity
        store.spin[:] = self._spin

    def _shape(self, half: float) -> int:
        steps = max(round(half / _SHAPE_STEP), 1)
        if steps not in self._shapes:
            self._shapes[steps] = pybullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=[steps * _SHAPE_STEP] * 3,
                physicsClientId=self._client,
            )
        return self._shapes[steps]

"""Two chains of shoes in pybullet: bodies of their own, each hinged to the next, round the wheels.

A hinge is two point-to-point constraints: of a body's own constraints the engine knows only those,
fixed ones and gears. Shoes touch the sprocket and the idler of their own side and nothing else.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.rotations import quaternion_from_matrix
from machine_sim.machine.spec import TrackSpec
from machine_sim.machine.tracks.running_gear import SIDES, initial_shoe_poses
from machine_sim.physics_engine import pybullet

__all__ = ["ShoeChains"]

Array = NDArray[np.float64]

_SHOE_FRICTION = 0.8
"""Coefficient of a shoe on the sprocket, to be multiplied with the sprocket's."""

_LATERAL_FRICTION_FACTOR = 0.05
"""Part of it that acts across the track. A shoe that sticks to the sprocket where it happens to
come in pulls the chain out of line, turn by turn."""

_SHOE_LENGTH_FACTOR = 0.98
"""Of a shoe, in parts of the distance between its hinges."""

_HINGE_OFFSET_FACTOR = 0.83
"""How far out the two halves of a hinge are, in parts of the half width."""

_MAX_CONSTRAINT_FORCE = 1e7
"""Greatest force of a constraint [N]; with pybullet's default of 500 the chain falls apart."""


class ShoeChains:
    """The shoes of both tracks, left track first."""

    def __init__(
        self, client: int, body: int, shape: TrackSpec, position: Array, rotation: Array
    ) -> None:
        """
        Args:
            client: number of the physics client.
            body: number of the machine's multibody in it, in place.
            shape: of the tracks, from `with_dynamic_tracks`.
            position, rotation: of the base frame, map frame [m], shapes (3,) and (3, 3).
        """
        self._client = client
        self._shoes: list[int] = []
        joints = range(pybullet.getNumJoints(body, client))
        links = {pybullet.getJointInfo(body, i, client)[1].decode(): i for i in joints}
        length = shape.sprocket_radius
        solid = pybullet.createCollisionShape(
            pybullet.GEOM_BOX,
            halfExtents=[
                0.5 * _SHOE_LENGTH_FACTOR * length,
                0.5 * shape.shoe_width,
                0.5 * shape.shoe_thickness,
            ],
            physicsClientId=client,
        )
        for side, y in zip(SIDES, (0.5 * shape.gauge, -0.5 * shape.gauge), strict=True):
            chain = [
                self._create_shoe(
                    solid, shape.belt_mass / shape.shoe_count, position, rotation, y, pose
                )
                for pose in initial_shoe_poses(shape).tolist()
            ]
            for shoe, following in zip(chain, [*chain[1:], chain[0]], strict=True):
                self._hinge(shoe, following, length, 0.5 * _HINGE_OFFSET_FACTOR * shape.shoe_width)
            wheels = [links[f"{wheel}_{side}"] for wheel in ("sprocket", "idler")]
            for wheel in wheels:
                for shoe in chain:
                    pybullet.setCollisionFilterPair(shoe, body, -1, wheel, 1, client)
                # Nothing but the pairs; it also has the engine look for them anew.
                pybullet.setCollisionFilterGroupMask(body, wheel, 0, 0, client)
            for shoe in chain:
                pybullet.setCollisionFilterGroupMask(shoe, -1, 0, 0, client)
            self._shoes += chain

    def read(self, states: Array) -> None:
        """Read where the shoes are and how they move.

        Args:
            states: out, position [m], quaternion x, y, z, w, velocity [m/s], angular velocity
                [rad/s] of each, map frame, shape (n, 13).
        """
        client = self._client
        for shoe, state in zip(self._shoes, states, strict=True):
            state[:3], state[3:7] = pybullet.getBasePositionAndOrientation(shoe, client)
            state[7:10], state[10:] = pybullet.getBaseVelocity(shoe, client)

    def apply_forces(self, forces: Array, positions: Array) -> None:
        """Let forces act in the next step.

        Args:
            forces: force [N] and torque about its middle [N m] on each shoe, map frame, (n, 6).
            positions: of the middles [m], map frame, shape (n, 3).
        """
        client, world = self._client, pybullet.WORLD_FRAME
        values, places = forces.tolist(), positions.tolist()
        for i in np.flatnonzero(np.any(forces, axis=1)).tolist():
            shoe, force = self._shoes[i], values[i]
            pybullet.applyExternalForce(shoe, -1, force[:3], places[i], world, client)
            if any(force[3:]):
                pybullet.applyExternalTorque(shoe, -1, force[3:], world, client)

    def _create_shoe(
        self,
        solid: int,
        mass: float,
        position: Array,
        rotation: Array,
        y: float,
        pose: list[float],
    ) -> int:
        """Make one shoe; returns its number."""
        x, z, pitch = pose
        s, c = math.sin(pitch), math.cos(pitch)
        turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        shoe: int = pybullet.createMultiBody(
            mass,
            solid,
            -1,
            (position + rotation @ np.array([x, y, z])).tolist(),
            quaternion_from_matrix(rotation @ turn),
            useMaximalCoordinates=1,
            physicsClientId=self._client,
        )
        pybullet.changeDynamics(
            shoe, -1, lateralFriction=_SHOE_FRICTION, anisotropicFriction=[1.0, _LATERAL_FRICTION_FACTOR, 1.0],
            linearDamping=0.0, angularDamping=0.0, physicsClientId=self._client,
        )  # fmt: skip
        return shoe

    def _hinge(self, shoe: int, following: int, length: float, out: float) -> None:
        """Join a shoe's far edge to the next one's near edge, `out` [m] to both sides."""
        for y in (out, -out):
            joint = pybullet.createConstraint(
                shoe, -1, following, -1, pybullet.JOINT_POINT2POINT, [0.0, 1.0, 0.0],
                [0.5 * length, y, 0.0], [-0.5 * length, y, 0.0], physicsClientId=self._client,
            )  # fmt: skip
            pybullet.changeConstraint(
                joint, maxForce=_MAX_CONSTRAINT_FORCE, physicsClientId=self._client
            )

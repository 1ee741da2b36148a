"""Two chains of rigid shoes in pybullet, hinged to each other around sprocket and idler.

A hinge is two point-to-point constraints: between separate bodies pybullet offers only those, fixed
constraints and gears. Shoes collide with the sprocket and the idler of their own side and with
nothing else.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.rotations import quaternion_from_matrix
from machine_sim.machine.spec import TrackSpec
from machine_sim.machine.tracks.running_gear import SIDES, initial_shoe_poses
from machine_sim.physics_engine import pybullet

__all__ = [
    "SHOE_ANGULAR_VELOCITY",
    "SHOE_POSITION",
    "SHOE_QUATERNION",
    "SHOE_STATE_SIZE",
    "SHOE_VELOCITY",
    "ShoeChains",
]

Array = NDArray[np.float64]

SHOE_POSITION, SHOE_QUATERNION, SHOE_VELOCITY, SHOE_ANGULAR_VELOCITY = 0, 3, 7, 10
"""First columns of position [m], quaternion x, y, z, w, velocity [m/s] and angular velocity
[rad/s] in the state of a shoe, map frame."""

SHOE_STATE_SIZE = 13
"""Number of columns in the state of a shoe."""

_SHOE_FRICTION = 0.8
"""Friction coefficient of a shoe on the sprocket, to be multiplied by the sprocket's."""

_LATERAL_FRICTION_FACTOR = 0.05
"""Fraction of the friction that acts across the track. A shoe that sticks to the sprocket with a
lateral offset would increase the offset of the chain at every turn."""

_SHOE_LENGTH_FACTOR = 0.98
"""Length of a shoe as a fraction of the distance between its hinges."""

_HINGE_OFFSET_FACTOR = 0.83
"""Lateral offset of both constraints of a hinge, in half widths."""

_MAX_CONSTRAINT_FORCE = 1e7
"""Maximum force of a constraint [N]; pybullet's default of 500 is too weak for the chain."""

_NUM_SOLVER_ITERATIONS = 30
"""Iterations of the constraint solver. With these, and friction in two directions, not in a cone, a
step of the engine takes two thirds of its time with pybullet's defaults."""

_ERROR_REDUCTION = 0.35
"""Fraction of the gap of a hinge that the solver corrects in a step. With pybullet's default of 0.2
the hinges of a chain under load gape by a third more."""


class ShoeChains:
    """The shoes of both tracks, left track first."""

    def __init__(
        self, client: int, body: int, tracks: TrackSpec, position: Array, rotation: Array
    ) -> None:
        """
        Args:
            client: id of the physics client.
            body: id of the machine's multibody, which is at its pose.
            tracks: tracks from `with_dynamic_tracks`.
            position, rotation: pose of the base frame, map frame [m], shapes (3,) and (3, 3).
        """
        self._client, self._tracks = client, tracks
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=_NUM_SOLVER_ITERATIONS,
            enableConeFriction=0,
            erp=_ERROR_REDUCTION,
            physicsClientId=client,
        )
        self._shoes: list[int] = []
        joints = range(pybullet.getNumJoints(body, client))
        links = {pybullet.getJointInfo(body, i, client)[1].decode(): i for i in joints}
        length = tracks.sprocket_radius
        solid = pybullet.createCollisionShape(
            pybullet.GEOM_BOX,
            halfExtents=[
                0.5 * _SHOE_LENGTH_FACTOR * length,
                0.5 * tracks.shoe_width,
                0.5 * tracks.shoe_thickness,
            ],
            physicsClientId=client,
        )
        for side, y in zip(SIDES, (0.5 * tracks.gauge, -0.5 * tracks.gauge), strict=True):
            chain = [
                self._create_shoe(
                    solid, tracks.belt_mass / tracks.shoe_count, position, rotation, y, pose
                )
                for pose in initial_shoe_poses(tracks).tolist()
            ]
            for shoe, following in zip(chain, [*chain[1:], chain[0]], strict=True):
                self._hinge(shoe, following, length, 0.5 * _HINGE_OFFSET_FACTOR * tracks.shoe_width)
            wheels = [links[f"{wheel}_{side}"] for wheel in ("sprocket", "idler")]
            for wheel in wheels:
                for shoe in chain:
                    pybullet.setCollisionFilterPair(shoe, body, -1, wheel, 1, client)
                # Only the pairs above collide; this call also makes pybullet update the pairs.
                pybullet.setCollisionFilterGroupMask(body, wheel, 0, 0, client)
            for shoe in chain:
                pybullet.setCollisionFilterGroupMask(shoe, -1, 0, 0, client)
            self._shoes += chain

    def place(
        self, side: int, position: Array, rotation: Array, velocity: Array, angular_velocity: Array
    ) -> None:
        """Put the shoes of one side on a new chain around its wheels, which moves with the base.

        Args:
            side: 0 for the left, 1 for the right.
            position, rotation: pose of the base frame, map frame [m], shapes (3,) and (3, 3).
            velocity, angular_velocity: of the origin of the base frame [m/s] and of the base
                [rad/s], map frame, shape (3,).
        """
        tracks, client = self._tracks, self._client
        y = 0.5 * tracks.gauge * (1 - 2 * side)
        shoes = self._shoes[side * tracks.shoe_count : (side + 1) * tracks.shoe_count]
        for shoe, pose in zip(shoes, initial_shoe_poses(tracks).tolist(), strict=True):
            center, quaternion = _shoe_pose(position, rotation, y, pose)
            shoe_velocity = velocity + np.cross(angular_velocity, center - position)
            pybullet.resetBasePositionAndOrientation(shoe, center.tolist(), quaternion, client)
            pybullet.resetBaseVelocity(
                shoe, shoe_velocity.tolist(), angular_velocity.tolist(), client
            )

    def read(self, states: Array) -> None:
        """Read pose and motion of the shoes.

        Args:
            states: out, states of the shoes in the columns `SHOE_POSITION` and following, map
                frame, shape (n, 13).
        """
        client, values = self._client, list[float]()
        read_pose, read_velocity = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        for shoe in self._shoes:
            position, quaternion = read_pose(shoe, client)
            velocity, angular_velocity = read_velocity(shoe, client)
            values += position
            values += quaternion
            values += velocity
            values += angular_velocity
        states.reshape(-1)[:] = values  # at once: assignments to slices take as long as the reading

    def apply_forces(self, forces: Array, positions: Array) -> None:
        """Apply forces in the next step.

        Args:
            forces: force [N] and torque about its centre [N m] on each shoe, map frame, shape
                (n, 6).
            positions: centres of the shoes [m], map frame, shape (n, 3).
        """
        client, world = self._client, pybullet.WORLD_FRAME
        wrenches, centers = forces.tolist(), positions.tolist()
        for i in np.flatnonzero(np.any(forces, axis=1)).tolist():
            shoe, (force, torque) = self._shoes[i], (wrenches[i][:3], wrenches[i][3:])
            pybullet.applyExternalForce(shoe, -1, force, centers[i], world, client)
            if any(torque):
                pybullet.applyExternalTorque(shoe, -1, torque, world, client)

    def _create_shoe(
        self,
        solid: int,
        mass: float,
        position: Array,
        rotation: Array,
        y: float,
        pose: list[float],
    ) -> int:
        """Create one shoe at lateral position `y` [m] and pose x, z, pitch; return its body id."""
        center, quaternion = _shoe_pose(position, rotation, y, pose)
        shoe: int = pybullet.createMultiBody(
            mass,
            solid,
            -1,
            center.tolist(),
            quaternion,
            useMaximalCoordinates=1,
            physicsClientId=self._client,
        )
        pybullet.changeDynamics(
            shoe,
            -1,
            lateralFriction=_SHOE_FRICTION,
            anisotropicFriction=[1.0, _LATERAL_FRICTION_FACTOR, 1.0],
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=self._client,
        )
        return shoe

    def _hinge(self, shoe: int, following: int, length: float, offset: float) -> None:
        """Hinge a shoe's front edge to the next one's rear edge, at `offset` [m] to both sides."""
        for y in (offset, -offset):
            joint = pybullet.createConstraint(
                shoe, -1, following, -1, pybullet.JOINT_POINT2POINT, [0.0, 1.0, 0.0],
                [0.5 * length, y, 0.0], [-0.5 * length, y, 0.0], physicsClientId=self._client,
            )  # fmt: skip
            pybullet.changeConstraint(
                joint, maxForce=_MAX_CONSTRAINT_FORCE, physicsClientId=self._client
            )


def _shoe_pose(
    position: Array, rotation: Array, y: float, pose: list[float]
) -> tuple[Array, list[float]]:
    """Return centre [m] and quaternion of a shoe in the map frame.

    Args:
        position, rotation: pose of the base frame.
        y: lateral position of the shoe [m].
        pose: its x, z [m] and pitch [rad], base frame.
    """
    x, z, pitch = pose
    s, c = math.sin(pitch), math.cos(pitch)
    pitch_rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    quaternion = quaternion_from_matrix(rotation @ pitch_rotation)
    return position + rotation @ np.array([x, y, z]), list(quaternion)

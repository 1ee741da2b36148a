"""One excavator in pybullet: base, upper body and arm as one multibody on its tracks.

The owner of the physics client runs the loop::

    machine.before_step(dt)   # ground's and soil's wrenches, motor targets
    client.stepSimulation()
    machine.after_step()      # read the new state once

Nothing of the terrain is in pybullet: the tracks feel it by themselves, the bucket through
`apply_tool_wrench`. Collisions there are only between rigid machines.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
import pybullet
from numpy.typing import ArrayLike, NDArray

from machine_sim.ground import Ground
from machine_sim.machine.description import JOINT_NAMES, MachineDescription
from machine_sim.machine.errors import MachineError
from machine_sim.machine.fast_tracks import FastTracks
from machine_sim.machine.hinged_tracks import HingedTracks
from machine_sim.machine.hydraulics import HydraulicArm
from machine_sim.machine.joints import JointReference
from machine_sim.machine.kinematics import cross, quaternion_of, rotation_matrix
from machine_sim.machine.tracks import TrackModel, Tracks, standing_pose
from msg_bridge.contract.cylinders import CylinderState

__all__ = ["OVERTURNED_TILT", "Excavator"]

Array = NDArray[np.float64]

OVERTURNED_TILT = 1.0
"""A base tilted more than this has fallen over [rad]; the tracks' edge is passed long before."""

_TRACKS: dict[TrackModel, type[FastTracks] | type[HingedTracks]] = {
    "fast": FastTracks,
    "physics": HingedTracks,
}

_POSITION_GAIN = 0.1
_VELOCITY_GAIN = 1.0


class Client(Protocol):
    """A `pybullet_utils.bullet_client.BulletClient`, as far as it is needed here."""

    _client: int


class Excavator:
    """A machine built from its description, standing on the ground.

    Attributes:
        description: what it is built from, with its tracks as they are.
        tracks: its tracks, with shoe poses and loads.
        hydraulics: its cylinders and what feeds them.
        body: its number in the physics client.
    """

    def __init__(
        self,
        description: MachineDescription,
        client: Client | int,
        ground: Ground,
        position: tuple[float, float] = (0.0, 0.0),
        yaw: float = 0.0,
        tracks: TrackModel = "fast",
    ) -> None:
        """
        Args:
            description: dimensions, masses and limits.
            client: physics client or its number; its owner sets step and gravity and steps it.
            ground: the terrain its tracks touch.
            position: where it is set down on the ground (x, y) [m], map frame.
            yaw: where it faces [rad], from +x counter-clockwise.
            tracks: how they are simulated.

        Raises:
            MachineError: a position off the map or not finite, or a description that tracks of
                this model cannot be made of.
        """
        x, y = _numbers(position, 2, "position")
        self.tracks: Tracks = _TRACKS[tracks](description, ground)
        self.description = description = self.tracks.description
        place, rotation = standing_pose(description, ground, x, y, yaw)
        self._client: int = client if isinstance(client, int) else client._client
        self._base_com = np.array(description.links["base"].center_of_mass)
        self._tool_com = np.array(description.links["bucket"].center_of_mass)
        self._limits = [description.joints[name] for name in JOINT_NAMES]
        self.hydraulics = HydraulicArm(
            JOINT_NAMES,
            [limit.torque for limit in self._limits],
            description.cylinders,
            description.supply,
        )
        self._command = [0.0] * len(JOINT_NAMES)
        self._reference = JointReference(self._limits, description.home)
        self._tool_force: Array = np.zeros(3)
        self._tool_torque: Array = np.zeros(3)  # about the tool frame's origin
        self._has_tool_wrench = False
        self.body, self._joints = self._load(place, rotation)
        self.after_step()

    def command(
        self, joint_velocities: Mapping[str, float] | ArrayLike, track_speeds: ArrayLike
    ) -> None:
        """Set the speeds wanted from now on; faster than the machine can is as fast as it can.

        Args:
            joint_velocities: swing, boom, arm, bucket [rad/s], shape (4,), or a mapping from joint
                name, where a joint not named holds. Zero holds the angle under load.
            track_speeds: left, right [m/s], shape (2,). Zero brakes.

        Raises:
            MachineError: an unknown joint, a wrong length, or a number that is not finite; the
                command before stays in force.
        """
        joints = _numbers(_in_order(joint_velocities), len(JOINT_NAMES), "joint velocities")
        tracks = _numbers(track_speeds, 2, "track speeds")
        top = self.description.tracks.max_speed
        self._command = [
            min(max(speed, -limit.speed), limit.speed)
            for speed, limit in zip(joints, self._limits, strict=True)
        ]
        self.tracks.command[:] = [min(max(speed, -top), top) for speed in tracks]

    def apply_tool_wrench(
        self, force: ArrayLike, torque: ArrayLike, point: ArrayLike | None = None
    ) -> None:
        """Add a wrench on the bucket for the next step only.

        Args:
            force: [N], map frame, shape (3,).
            torque: about `point` [N m], map frame, shape (3,).
            point: where the force acts [m], map frame; the tool frame's origin if not given.

        Raises:
            MachineError: a wrong length or a number that is not finite; nothing is added.
        """
        f = np.array(_numbers(force, 3, "tool force"))
        t = np.array(_numbers(torque, 3, "tool torque"))
        if point is not None:
            t += cross(np.array(_numbers(point, 3, "point of the wrench")) - self._origin, f)
        self._tool_force += f
        self._tool_torque += t
        self._has_tool_wrench = True

    def before_step(self, dt: float) -> None:
        """Give the physics engine what acts on the machine in its next step of `dt` [s]."""
        wrench = self.tracks.step(
            dt, self._com, self._rotation, self._com_velocity, self._spin, self._angles[0]
        ).tolist()
        body, client, world = self.body, self._client, pybullet.WORLD_FRAME
        pybullet.applyExternalForce(body, -1, wrench[:3], self._com_list, world, client)
        pybullet.applyExternalTorque(body, -1, wrench[3:], world, client)
        if self._has_tool_wrench:
            bucket = self._joints[-1]
            force, torque = self._tool_force.tolist(), self._tool_torque.tolist()
            pybullet.applyExternalForce(body, bucket, force, self._origin.tolist(), world, client)
            pybullet.applyExternalTorque(body, bucket, torque, world, client)
            self._tool_force[:] = 0.0
            self._tool_torque[:] = 0.0
            self._has_tool_wrench = False
        reference, hydraulics = self._reference, self.hydraulics
        reference.command = hydraulics.attainable(self._command, self._angles, self._efforts)
        reference.advance(dt, self._angles)
        moves = [rate != 0.0 for rate in reference.rate]
        torques = hydraulics.torque_limits(moves, self._angles, self._efforts)
        pybullet.setJointMotorControlArray(
            body,
            self._joints,
            pybullet.POSITION_CONTROL,
            reference.angle,
            reference.rate,
            torques,
            self._position_gains,
            self._velocity_gains,
            physicsClientId=client,
        )

    def after_step(self) -> None:
        """Read the machine's state; every property is of this moment until the next call.

        Raises:
            MachineError: the state is no longer finite, so the run cannot go on.
        """
        body, client = self.body, self._client
        self._com_list, quaternion = pybullet.getBasePositionAndOrientation(body, client)
        velocity, spin = pybullet.getBaseVelocity(body, client)
        states = pybullet.getJointStates(body, self._joints, client)
        tool = pybullet.getLinkState(body, self._joints[-1], 1, 1, client)
        self._com = np.array(self._com_list)
        self._quaternion = np.array(quaternion)
        self._rotation = rotation_matrix(quaternion)
        self._com_velocity = np.array(velocity)
        self._spin = np.array(spin)
        self._angles = [state[0] for state in states]
        self._rates = [state[1] for state in states]
        self._efforts = [state[3] for state in states]
        # [4] and [5] are the link frame; [0] and [1] would be that of the centre of mass.
        self._origin = np.array(tool[4])
        self._tool_rotation = rotation_matrix(tool[5])
        self._tool_com_velocity, self._tool_spin = tool[6], tool[7]
        if not math.isfinite(sum(velocity) + sum(spin) + sum(self._rates)):
            raise MachineError(
                "the machine's motion is not finite any more; look for a tool wrench far beyond"
                " its strength, or take a shorter time step"
            )

    @property
    def joint_positions(self) -> Array:
        """Angles of swing, boom, arm, bucket [rad], shape (4,)."""
        return np.array(self._angles)

    @property
    def joint_velocities(self) -> Array:
        """Speeds of swing, boom, arm, bucket [rad/s], shape (4,)."""
        return np.array(self._rates)

    @property
    def joint_efforts(self) -> Array:
        """Drive torques of swing, boom, arm, bucket in the last step [N m], shape (4,)."""
        return np.array(self._efforts)

    @property
    def cylinders(self) -> dict[str, CylinderState]:
        """The cylinders, by the joint that they turn."""
        return self.hydraulics.states(self._angles, self._rates, self._efforts)

    @property
    def base_pose(self) -> tuple[Array, Array]:
        """Origin of `base_link` [m], shape (3,), and quaternion x, y, z, w, map frame."""
        return self._com - self._rotation @ self._base_com, self._quaternion.copy()

    @property
    def base_velocity(self) -> tuple[Array, Array]:
        """Velocity of `base_link`'s origin [m/s] and angular velocity [rad/s], map frame."""
        arm = self._rotation @ self._base_com
        return self._com_velocity - cross(self._spin, arm), self._spin.copy()

    @property
    def tool_pose(self) -> tuple[Array, Array]:
        """Rotation bucket to map, shape (3, 3), and the bucket frame's origin [m], shape (3,)."""
        return self._tool_rotation, self._origin

    @property
    def tool_velocity(self) -> tuple[Array, Array]:
        """Velocity of the bucket frame's origin [m/s], angular velocity [rad/s], map frame."""
        spin = np.array(self._tool_spin)
        arm = self._tool_rotation @ self._tool_com
        return np.array(self._tool_com_velocity) - cross(spin, arm), spin

    @property
    def tilt(self) -> float:
        """Angle between the base's z axis and the vertical [rad]."""
        return math.acos(min(max(float(self._rotation[2, 2]), -1.0), 1.0))

    @property
    def overturned(self) -> bool:
        """Whether the machine has fallen over."""
        return self.tilt > OVERTURNED_TILT

    def _load(self, place: Array, rotation: Array) -> tuple[int, list[int]]:
        """Build the multibody at its place in the home pose; returns its number and its joints."""
        client = self._client
        handle, name = tempfile.mkstemp(suffix=".urdf")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(self.tracks.urdf())
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_MAINTAIN_LINK_ORDER
            body: int = pybullet.loadURDF(name, flags=flags, physicsClientId=client)
        finally:
            Path(name).unlink()
        joints = {}
        for i in range(pybullet.getNumJoints(body, client)):
            joints[pybullet.getJointInfo(body, i, client)[1].decode()] = i
        order = [joints[joint] for joint in JOINT_NAMES]
        for i in range(-1, len(joints)):
            # Bullet damps every body a little unless told not to.
            pybullet.changeDynamics(
                body, i, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                physicsClientId=client,
            )  # fmt: skip
        for i, angle in zip(order, self.description.home.tolist(), strict=True):
            pybullet.resetJointState(body, i, angle, 0.0, client)
        com = place + rotation @ self._base_com  # where pybullet counts a base's position
        pybullet.resetBasePositionAndOrientation(
            body, com.tolist(), quaternion_of(rotation), physicsClientId=client
        )
        self.tracks.attach(client, body, place, rotation)
        self._position_gains = [_POSITION_GAIN] * len(order)
        self._velocity_gains = [_VELOCITY_GAIN] * len(order)
        return body, order


def _in_order(velocities: Mapping[str, float] | ArrayLike) -> ArrayLike:
    if not isinstance(velocities, Mapping):
        return velocities
    unknown = sorted(str(name) for name in velocities if name not in JOINT_NAMES)
    if unknown:
        raise MachineError(
            f"there is no joint {', '.join(unknown)}; the joints are {', '.join(JOINT_NAMES)}"
        )
    return [velocities.get(name, 0.0) for name in JOINT_NAMES]


def _numbers(values: ArrayLike, length: int, what: str) -> list[float]:
    """The values as finite floats.

    Raises:
        MachineError: there are more or fewer than `length`, or one is not finite.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise MachineError(f"{what} {values!r}: give {length} numbers") from None
    if array.shape != (length,) or not np.isfinite(array).all():
        raise MachineError(f"{what} {values!r}: give {length} finite numbers")
    numbers: list[float] = array.tolist()
    return numbers

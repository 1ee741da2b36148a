"""One machine in pybullet: its links as one multibody on two tracks.

The owner of the physics client runs the loop::

    machine.before_step(dt)   # ground's and soil's wrenches, motor targets
    client.stepSimulation()
    machine.after_step()      # read the new state once

Nothing of the terrain is in pybullet: the tracks feel it by themselves, the tools through
`Tool.push`. Collisions there are only between rigid machines.
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
from machine_sim.machine.description import BASE, MachineDescription
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulics import HydraulicArm
from machine_sim.machine.joints import JointReference
from machine_sim.machine.kinematics import cross, quaternion_of, rotation_matrix
from machine_sim.machine.numbers import finite_numbers
from machine_sim.machine.tools.tool import Tool
from machine_sim.machine.tracks.fast import FastTracks
from machine_sim.machine.tracks.hinged import HingedTracks
from machine_sim.machine.tracks.model import TrackModel, Tracks, standing_pose
from msg_bridge.contract.cylinders import CylinderState

__all__ = ["OVERTURNED_TILT", "TrackedMachine"]

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


class TrackedMachine:
    """A machine built from its description, standing on the ground.

    Attributes:
        description: what it is built from, with its tracks as they are.
        tracks: its tracks, with shoe poses and loads.
        hydraulics: its cylinders and what feeds them.
        tools: its tools, by name.
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
        x, y = finite_numbers(position, 2, "position")
        self.tracks: Tracks = _TRACKS[tracks](description, ground)
        self.description = description = self.tracks.description
        place, rotation = standing_pose(description, ground, x, y, yaw)
        self._client: int = client if isinstance(client, int) else client._client
        self._base_com = np.array(description.links[BASE].center_of_mass)
        names = description.joint_names
        self._limits = list(description.joints.values())
        self.hydraulics = HydraulicArm(
            names,
            [limit.torque for limit in self._limits],
            description.cylinders,
            description.supply,
        )
        self._command = [0.0] * len(names)
        self._reference = JointReference(self._limits, description.home)
        self.body, self._joints = self._load(place, rotation)
        children = [joint.child for joint in description.joints.values()]
        self.tools = {
            name: Tool(
                self._client,
                self.body,
                self._joints[children.index(mount.link)],
                mount.shape,
                description.links[mount.link],
            )
            for name, mount in description.tools.items()
        }
        # The joint that turns the hull, whose corners meet the ground where the machine falls over.
        self._hull_joint = children.index(description.hull) if description.hull != BASE else None
        self.after_step()

    def command(
        self, joint_velocities: Mapping[str, float] | ArrayLike, track_speeds: ArrayLike
    ) -> None:
        """Set the speeds wanted from now on; faster than the machine can is as fast as it can.

        Args:
            joint_velocities: of all joints [rad/s], shape (joints,), or a mapping from joint name,
                where a joint not named holds. Zero holds the angle under load.
            track_speeds: left, right [m/s], shape (2,). Zero brakes.

        Raises:
            MachineError: an unknown joint, a wrong length, or a number that is not finite; the
                command before stays in force.
        """
        values = self._in_order(joint_velocities)
        joints = finite_numbers(values, len(self._limits), "joint velocities")
        tracks = finite_numbers(track_speeds, 2, "track speeds")
        top = self.description.tracks.max_speed
        self._command = [
            min(max(speed, -limit.speed), limit.speed)
            for speed, limit in zip(joints, self._limits, strict=True)
        ]
        self.tracks.command[:] = [min(max(speed, -top), top) for speed in tracks]

    def before_step(self, dt: float) -> None:
        """Give the physics engine what acts on the machine in its next step of `dt` [s]."""
        wrench = self.tracks.step(
            dt, self._com, self._rotation, self._com_velocity, self._spin, self._hull_angle
        ).tolist()
        body, client, world = self.body, self._client, pybullet.WORLD_FRAME
        pybullet.applyExternalForce(body, -1, wrench[:3], self._com_list, world, client)
        pybullet.applyExternalTorque(body, -1, wrench[3:], world, client)
        for tool in self.tools.values():
            tool.before_step()
        if self._joints:
            self._drive(dt)

    def after_step(self) -> None:
        """Read the machine's state; every property is of this moment until the next call.

        Raises:
            MachineError: the state is no longer finite, so the run cannot go on.
        """
        body, client = self.body, self._client
        self._com_list, quaternion = pybullet.getBasePositionAndOrientation(body, client)
        velocity, spin = pybullet.getBaseVelocity(body, client)
        # A machine without joints is asked for none: pybullet has no answer to an empty list.
        states = pybullet.getJointStates(body, self._joints, client) if self._joints else ()
        self._com = np.array(self._com_list)
        self._quaternion = np.array(quaternion)
        self._rotation = rotation_matrix(quaternion)
        self._com_velocity = np.array(velocity)
        self._spin = np.array(spin)
        self._angles = [state[0] for state in states]
        self._rates = [state[1] for state in states]
        self._efforts = [state[3] for state in states]
        for tool in self.tools.values():
            tool.after_step()
        if not math.isfinite(sum(velocity) + sum(spin) + sum(self._rates)):
            raise MachineError(
                "the machine's motion is not finite any more; look for a tool wrench far beyond"
                " its strength, or take a shorter time step"
            )

    @property
    def joint_positions(self) -> Array:
        """Angles [rad], shape (joints,)."""
        return np.array(self._angles)

    @property
    def joint_velocities(self) -> Array:
        """Speeds [rad/s], shape (joints,)."""
        return np.array(self._rates)

    @property
    def joint_efforts(self) -> Array:
        """Drive torques in the last step [N m], shape (joints,)."""
        return np.array(self._efforts)

    @property
    def cylinders(self) -> dict[str, CylinderState]:
        """The cylinders, by the joint that they turn."""
        return self.hydraulics.states(self._angles, self._rates, self._efforts)

    @property
    def base_pose(self) -> tuple[Array, Array]:
        """Origin of `base_link` [m], shape (3,), and quaternion x, y, z, w, map frame."""
        return self.base_frame[1], self._quaternion.copy()

    @property
    def base_frame(self) -> tuple[Array, Array]:
        """Rotation of `base_link` to map, shape (3, 3), and its origin [m], shape (3,)."""
        return self._rotation, self._com - self._rotation @ self._base_com

    @property
    def base_velocity(self) -> tuple[Array, Array]:
        """Velocity of `base_link`'s origin [m/s] and angular velocity [rad/s], map frame."""
        arm = self._rotation @ self._base_com
        return self._com_velocity - cross(self._spin, arm), self._spin.copy()

    @property
    def tool(self) -> Tool:
        """The first tool, of most machines the only one.

        Raises:
            MachineError: it has none.
        """
        for tool in self.tools.values():
            return tool
        raise MachineError(f"a {self.description.name} has no tool; give it `tools`")

    @property
    def _hull_angle(self) -> float:
        return 0.0 if self._hull_joint is None else self._angles[self._hull_joint]

    @property
    def tilt(self) -> float:
        """Angle between the base's z axis and the vertical [rad]."""
        return math.acos(min(max(float(self._rotation[2, 2]), -1.0), 1.0))

    @property
    def overturned(self) -> bool:
        """Whether the machine has fallen over."""
        return self.tilt > OVERTURNED_TILT

    def _drive(self, dt: float) -> None:
        """Give the joints' motors their targets for the next step of `dt` [s]."""
        reference, hydraulics = self._reference, self.hydraulics
        reference.command = hydraulics.attainable(self._command, self._angles, self._efforts)
        reference.advance(dt, self._angles)
        moves = [rate != 0.0 for rate in reference.rate]
        torques = hydraulics.torque_limits(moves, self._angles, self._efforts)
        pybullet.setJointMotorControlArray(
            self.body,
            self._joints,
            pybullet.POSITION_CONTROL,
            reference.angle,
            reference.rate,
            torques,
            self._position_gains,
            self._velocity_gains,
            physicsClientId=self._client,
        )

    def _in_order(self, velocities: Mapping[str, float] | ArrayLike) -> ArrayLike:
        if not isinstance(velocities, Mapping):
            return velocities
        names = self.description.joint_names
        unknown = sorted(str(name) for name in velocities if name not in names)
        if unknown:
            raise MachineError(
                f"there is no joint {', '.join(unknown)}; the joints are {', '.join(names)}"
            )
        return [velocities.get(name, 0.0) for name in names]

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
        order = [joints[joint] for joint in self.description.joints]
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

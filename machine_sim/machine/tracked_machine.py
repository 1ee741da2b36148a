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
from numpy.typing import ArrayLike, NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulics import HydraulicSystem
from machine_sim.machine.joint_reference import JointReference
from machine_sim.machine.rotations import cross, quaternion_from_matrix, rotation_matrix
from machine_sim.machine.spec import BASE, MachineSpec
from machine_sim.machine.tools.tool import Tool
from machine_sim.machine.tracks import (
    DynamicTracks,
    KinematicTracks,
    TrackModel,
    Tracks,
    standing_pose,
)
from machine_sim.machine.validation import finite_numbers
from machine_sim.physics_engine import pybullet
from msg_bridge.contract.cylinder_state import CylinderState

__all__ = ["OVERTURNED_TILT", "TrackedMachine"]

Array = NDArray[np.float64]

OVERTURNED_TILT = 1.0
"""A base tilted more than this has fallen over [rad]; the tracks' edge is passed long before."""

_TRACK_CLASSES: dict[TrackModel, type[KinematicTracks] | type[DynamicTracks]] = {
    "kinematic": KinematicTracks,
    "dynamic": DynamicTracks,
}

_POSITION_GAIN = 0.1
_VELOCITY_GAIN = 1.0


class PhysicsClient(Protocol):
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
        spec: MachineSpec,
        client: PhysicsClient | int,
        ground: Ground,
        position: tuple[float, float] = (0.0, 0.0),
        yaw: float = 0.0,
        track_model: TrackModel = "kinematic",
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
        self.tracks: Tracks = _TRACK_CLASSES[track_model](spec, ground)
        self.spec = spec = self.tracks.spec
        place, rotation = standing_pose(spec, ground, x, y, yaw)
        self._client: int = client if isinstance(client, int) else client._client
        self._base_com = np.array(spec.links[BASE].center_of_mass)
        names = spec.joint_names
        self._limits = list(spec.joints.values())
        self.hydraulics = HydraulicSystem(
            names,
            [limit.max_effort for limit in self._limits],
            spec.cylinders,
            spec.supply,
        )
        self._command = [0.0] * len(names)
        self._reference = JointReference(self._limits, spec.home)
        self.body, self._joints = self._load(place, rotation)
        children = [joint.child for joint in spec.joints.values()]
        self.tools = {
            name: Tool(
                self._client,
                self.body,
                self._joints[children.index(mount.link)],
                mount.shape,
                spec.links[mount.link],
            )
            for name, mount in spec.tools.items()
        }
        # The joint that turns the hull, whose corners meet the ground where the machine falls over.
        self._main_body_joint = children.index(spec.main_body) if spec.main_body != BASE else None
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
        values = self._ordered_velocities(joint_velocities)
        joints = finite_numbers(values, len(self._limits), "joint velocities")
        tracks = finite_numbers(track_speeds, 2, "track speeds")
        top = self.spec.tracks.max_speed
        self._command = [
            min(max(speed, -limit.max_velocity), limit.max_velocity)
            for speed, limit in zip(joints, self._limits, strict=True)
        ]
        self.tracks.command[:] = [min(max(speed, -top), top) for speed in tracks]

    def before_step(self, dt: float) -> None:
        """Give the physics engine what acts on the machine in its next step of `dt` [s]."""
        wrench = self.tracks.step(
            dt,
            self._com,
            self._rotation,
            self._com_velocity,
            self._angular_velocity,
            self._main_body_angle,
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
        velocity, angular_velocity = pybullet.getBaseVelocity(body, client)
        # A machine without joints is asked for none: pybullet has no answer to an empty list.
        states = pybullet.getJointStates(body, self._joints, client) if self._joints else ()
        self._com = np.array(self._com_list)
        self._quaternion = np.array(quaternion)
        self._rotation = rotation_matrix(quaternion)
        self._com_velocity = np.array(velocity)
        self._angular_velocity = np.array(angular_velocity)
        self._angles = [state[0] for state in states]
        self._rates = [state[1] for state in states]
        self._efforts = [state[3] for state in states]
        for tool in self.tools.values():
            tool.after_step()
        if not math.isfinite(sum(velocity) + sum(angular_velocity) + sum(self._rates)):
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
        return self._com_velocity - cross(
            self._angular_velocity, arm
        ), self._angular_velocity.copy()

    @property
    def tool(self) -> Tool:
        """The first tool, of most machines the only one.

        Raises:
            MachineError: it has none.
        """
        for tool in self.tools.values():
            return tool
        raise MachineError(f"a {self.spec.name} has no tool; give it `tools`")

    @property
    def _main_body_angle(self) -> float:
        return 0.0 if self._main_body_joint is None else self._angles[self._main_body_joint]

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
        reference.command = hydraulics.attainable_speeds(self._command, self._angles, self._efforts)
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

    def _ordered_velocities(self, velocities: Mapping[str, float] | ArrayLike) -> ArrayLike:
        if not isinstance(velocities, Mapping):
            return velocities
        names = self.spec.joint_names
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
        order = [joints[joint] for joint in self.spec.joints]
        for i in range(-1, len(joints)):
            # Bullet damps every body a little unless told not to.
            pybullet.changeDynamics(
                body, i, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                physicsClientId=client,
            )  # fmt: skip
        for i, angle in zip(order, self.spec.home.tolist(), strict=True):
            pybullet.resetJointState(body, i, angle, 0.0, client)
        com = place + rotation @ self._base_com  # where pybullet counts a base's position
        pybullet.resetBasePositionAndOrientation(
            body, com.tolist(), quaternion_from_matrix(rotation), physicsClientId=client
        )
        self.tracks.attach(client, body, place, rotation)
        self._position_gains = [_POSITION_GAIN] * len(order)
        self._velocity_gains = [_VELOCITY_GAIN] * len(order)
        return body, order

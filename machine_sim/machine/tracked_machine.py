"""One machine in pybullet: its links as one multibody on two tracks.

The owner of the physics client runs the loop::

    machine.before_step(dt)   # wrenches of ground and soil, motor targets
    client.stepSimulation()
    machine.after_step()      # reads the new state once

The physics engine has no terrain: the tracks compute their contact with the ground themselves, and
the forces of the soil on tools are applied through `Tool.push`. The engine's collisions are only
those between rigid machines.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.actuator_step import ActuatorTables
from machine_sim.machine.base_motion import (
    ANGULAR_VELOCITY,
    ORIGIN,
    ROTATION,
    VELOCITY,
    base_motion,
)
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulics import HydraulicSystem
from machine_sim.machine.joint_reference import JointReference
from machine_sim.machine.joint_table import (
    ANGLE,
    EFFORT,
    LOWER,
    TARGET_ANGLE,
    TARGET_RATE,
    TORQUE_LIMIT,
    UPPER,
)
from machine_sim.machine.multibody import load_multibody
from machine_sim.machine.rotations import cross
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
from machine_sim.machine.valves import Valves
from machine_sim.physics_engine import pybullet
from msg_bridge.contract.cylinder_state import CylinderState
from msg_bridge.kernels import box_table

__all__ = ["OVERTURNED_TILT", "TrackedMachine"]

Array = NDArray[np.float64]

OVERTURNED_TILT = 1.0
"""Tilt of the base above which the machine has overturned [rad]; it tips over its tracks at far
smaller tilts."""

_TRACK_CLASSES: dict[TrackModel, type[KinematicTracks] | type[DynamicTracks]] = {
    "kinematic": KinematicTracks,
    "dynamic": DynamicTracks,
}

_POSITION_GAIN = 0.1
"""Fraction of a joint's angle error that its motor corrects in one step."""
_VELOCITY_GAIN = 1.0
"""Fraction of a joint's velocity error that its motor corrects in one step."""


class PhysicsClient(Protocol):
    """The part of `pybullet_utils.bullet_client.BulletClient` that is used here."""

    _client: int


class TrackedMachine:
    """A machine on the ground, built from its specification.

    Attributes:
        spec: specification of the machine, with the tracks of its track model.
        tracks: its tracks, with shoe poses and loads.
        hydraulics: its cylinders and their supply.
        tools: its tools, by name.
        client_id: id of the physics client.
        body: id of its multibody in the physics client.
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
            spec: dimensions, masses and limits.
            client: physics client or its id; its owner sets time step and gravity and steps it.
            ground: terrain under the tracks.
            position: initial position on the ground (x, y) [m], map frame.
            yaw: initial heading [rad], counter-clockwise from +x.
            track_model: model of the tracks.

        Raises:
            MachineError: a position that is off the map or not finite, or a specification that
                is not suitable for the track model.
        """
        x, y = finite_numbers(position, 2, "position")
        self.tracks: Tracks = _TRACK_CLASSES[track_model](spec, ground)
        self.spec = spec = self.tracks.spec
        self.client_id: int = client if isinstance(client, int) else client._client
        self._base_com = np.array(spec.links[BASE].center_of_mass)
        self._limits = list(spec.joints.values())
        self.hydraulics = HydraulicSystem(
            spec.joint_names,
            spec.cylinders,
            spec.motors,
            spec.tracks.motor,
            spec.supply,
        )
        self._angles: tuple[float, ...] = ()
        self._rates: tuple[float, ...] = ()
        self._efforts: tuple[float, ...] = ()
        joint_speeds = [limit.max_velocity for limit in self._limits]
        self._max_speeds = [*joint_speeds, *[spec.tracks.max_speed] * 2]  # joints, then tracks
        self._command = [0.0] * len(self._max_speeds)
        self._valves = self._make_valves()
        motor_joints = [spec.joint_names.index(name) for name in spec.motors]
        self._reference = JointReference(self._limits, spec.home, motor_joints)
        # A view; the stubs of NumPy do not declare arrays as buffers.
        self._joint_motion: Any = self._reference.table[ANGLE : EFFORT + 1].reshape(-1)
        self._joint_motion_format = f"{self._joint_motion.size}d"
        self._motor_targets = self._reference.table[TARGET_ANGLE : TORQUE_LIMIT + 1]  # another
        self._actuators = box_table(
            ActuatorTables(
                self._valves.table,
                self._reference.table,
                self.hydraulics.cylinder_table,
                self.hydraulics.motor_table,
                self.hydraulics.supply_table,
                self.tracks.drive_forces,
                self.tracks.command,
            )
        )
        pose = standing_pose(spec, ground, x, y, yaw)
        self.body, self._joints = load_multibody(self.client_id, self.tracks.urdf(), spec, *pose)
        self.tracks.attach(self.client_id, self.body, *pose)
        self._position_gains = [_POSITION_GAIN] * len(self._joints)
        self._velocity_gains = [_VELOCITY_GAIN] * len(self._joints)
        children = [joint.child for joint in spec.joints.values()]
        self.tools = {
            name: Tool(
                self.client_id,
                self.body,
                self._joints[children.index(mount.link)],
                mount.shape,
                spec.links[mount.link],
                self._limits[children.index(mount.link)].max_effort,
            )
            for name, mount in spec.tools.items()
        }
        self._moved_tools = [  # each tool, and the index of the joint that moves it
            (self.tools[name], children.index(mount.link)) for name, mount in spec.tools.items()
        ]
        self._main_body_joint = children.index(spec.main_body) if spec.main_body != BASE else None
        self.after_step()

    def continue_from(self, other: TrackedMachine) -> None:
        """Take pose, motion and commands of a machine that may have another specification.

        The machines may differ in dimensions, masses, actuators and tools, but not in the names of
        their joints. Joint angles are limited to the range of this machine; tracks have no
        shear displacement, and the engine has no load.

        Raises:
            MachineError: other joints, or the tracks of one of the machines are bodies of their
                own.
        """
        if self.spec.joint_names != other.spec.joint_names:
            raise MachineError(
                f"the machine has the joints {', '.join(other.spec.joint_names)}, and"
                f" {', '.join(self.spec.joint_names)} are given; give a machine with these joints"
            )
        if isinstance(self.tracks, DynamicTracks) or isinstance(other.tracks, DynamicTracks):
            raise MachineError(
                "the track model cannot be changed, nor a machine with dynamic tracks"
            )
        origin, quaternion = other.base_pose
        velocity, angular_velocity = other.base_velocity
        arm = other.base_frame[0] @ self._base_com
        body, client = self.body, self.client_id
        pybullet.resetBasePositionAndOrientation(body, origin + arm, quaternion, client)
        com_velocity = velocity + cross(angular_velocity, arm)
        pybullet.resetBaseVelocity(body, com_velocity, angular_velocity, client)
        for joint, angle, rate, limit in zip(
            self._joints, other._angles, other._rates, self._limits, strict=True
        ):
            within = min(max(angle, limit.lower), limit.upper)
            pybullet.resetJointState(body, joint, within, rate, client)
        reference = self._reference.table
        reference[TARGET_ANGLE : TARGET_RATE + 1] = other._reference.table[
            TARGET_ANGLE : TARGET_RATE + 1
        ]
        reference[TARGET_ANGLE] = np.clip(
            reference[TARGET_ANGLE], reference[LOWER], reference[UPPER]
        )
        self._command = list(other._command)
        self._valves.continue_from(other._valves)
        self.after_step()

    def command(
        self, joint_velocities: Mapping[str, float] | ArrayLike, track_speeds: ArrayLike
    ) -> None:
        """Set the commanded speeds, limited to the maximum speeds of the machine.

        Args:
            joint_velocities: velocities of all joints [rad/s], shape (joints,), or a mapping from
                joint name to velocity; joints that are not in it hold their angles, as at zero.
            track_speeds: belt speeds left, right [m/s], shape (2,); zero brakes.

        Raises:
            MachineError: an unknown joint, a wrong length, or a number that is not finite; the
                previous command remains in effect.
        """
        values = self._ordered_velocities(joint_velocities)
        speeds = finite_numbers(values, len(self._limits), "joint velocities")
        speeds += finite_numbers(track_speeds, 2, "track speeds")
        self._command = [
            min(max(speed, -max_speed), max_speed)
            for speed, max_speed in zip(speeds, self._max_speeds, strict=True)
        ]
        for tool, joint in self._moved_tools:
            if tool.shape.spins:
                tool.commanded_drum_speed = self._command[joint]

    def before_step(self, dt: float) -> None:
        """Apply forces and motor targets for the physics engine's next step of `dt` [s]."""
        self._valves.transmit(dt, self._command)
        wrench = self.tracks.step(dt, self._motion, self._main_body_angle, self._actuators)
        self._set_joint_motors()
        body, client, world = self.body, self.client_id, pybullet.WORLD_FRAME
        pybullet.applyExternalForce(body, -1, wrench[:3], self._com_list, world, client)
        pybullet.applyExternalTorque(body, -1, wrench[3:], world, client)
        for tool in self.tools.values():
            tool.before_step()

    def after_step(self) -> None:
        """Read the state after a step; every property has that state until the next call.

        Raises:
            MachineError: the state is not finite, so that the run cannot continue.
        """
        body, client = self.body, self.client_id
        self._com_list, self._quaternion = pybullet.getBasePositionAndOrientation(body, client)
        velocity, angular_velocity = pybullet.getBaseVelocity(body, client)
        self._motion = base_motion(
            self._com_list, self._quaternion, velocity, angular_velocity, self._base_com
        )
        if self._joints:  # pybullet does not accept an empty list
            states = pybullet.getJointStates(body, self._joints, client)
            self._angles, self._rates, _, self._efforts = zip(*states, strict=True)
            values = self._angles + self._rates + self._efforts
            # In half the time of NumPy, which first finds the type and the shape of the values.
            struct.pack_into(self._joint_motion_format, self._joint_motion, 0, *values)
        for tool, joint in self._moved_tools:
            tool.after_step(self._angles[joint], self._rates[joint])
        if not math.isfinite(sum(velocity + angular_velocity + self._rates)):
            raise MachineError(
                "the machine's motion is not finite; check for a tool wrench far above its"
                " strength, or take a shorter time step"
            )

    @property
    def joint_positions(self) -> Array:
        """Joint angles [rad], shape (joints,)."""
        return np.array(self._angles)

    @property
    def joint_velocities(self) -> Array:
        """Joint velocities [rad/s], shape (joints,)."""
        return np.array(self._rates)

    @property
    def joint_efforts(self) -> Array:
        """Drive torques in the last step [N m], shape (joints,)."""
        return np.array(self._efforts)

    @property
    def drive_efforts(self) -> list[float]:
        """Drive torques of the joints [N m], then forces of the tracks' drives on their belts [N],
        in the last step.
        """
        return [*self._efforts, *self.tracks.drive_forces.tolist()]

    @property
    def cylinders(self) -> dict[str, CylinderState]:
        """State of the cylinders, by the joint that they drive."""
        return self.hydraulics.states(self._angles, self._rates, self._efforts)

    @property
    def base_pose(self) -> tuple[Array, Array]:
        """Origin of `base_link` [m], shape (3,), and quaternion x, y, z, w, map frame."""
        _, origin = self.base_frame
        return origin, np.array(self._quaternion)

    @property
    def base_frame(self) -> tuple[Array, Array]:
        """Rotation matrix `base_link` to map, shape (3, 3), and its origin [m], shape (3,)."""
        return self._motion[ROTATION], self._motion[ORIGIN]

    @property
    def base_velocity(self) -> tuple[Array, Array]:
        """Velocity of `base_link`'s origin [m/s] and angular velocity [rad/s], map frame."""
        angular_velocity = self._motion[ANGULAR_VELOCITY].copy()
        arm = self._motion[ROTATION].dot(self._base_com)
        return self._motion[VELOCITY] - cross(angular_velocity, arm), angular_velocity

    @property
    def tool(self) -> Tool:
        """The first tool; most machines have only one.

        Raises:
            MachineError: the machine has no tool.
        """
        for tool in self.tools.values():
            return tool
        raise MachineError(f"machine type {self.spec.name} has no tool; add one under `tools`")

    @property
    def tilt(self) -> float:
        """Angle between the base's z axis and the vertical [rad]."""
        return math.acos(min(max(float(self._motion[2, 2]), -1.0), 1.0))

    @property
    def overturned(self) -> bool:
        """Whether the machine has overturned."""
        return self.tilt > OVERTURNED_TILT

    @property
    def _main_body_angle(self) -> float:
        """Angle of the joint between base and main body [rad]."""
        return 0.0 if self._main_body_joint is None else self._angles[self._main_body_joint]

    def _make_valves(self) -> Valves:
        """Return the valves of joints and tracks."""
        spec = self.spec
        is_hydraulic = [name in spec.cylinders or name in spec.motors for name in spec.joints]
        return Valves(
            spec.supply,
            self._max_speeds,
            [*is_hydraulic, *[spec.tracks.motor is not None] * 2],
        )

    def _set_joint_motors(self) -> None:
        """Set the targets of the joint motors for the next step."""
        if not self._joints:
            return
        angles, rates, torques = self._motor_targets.tolist()
        pybullet.setJointMotorControlArray(
            self.body,
            self._joints,
            pybullet.POSITION_CONTROL,
            angles,
            rates,
            torques,
            self._position_gains,
            self._velocity_gains,
            self.client_id,
        )

    def _ordered_velocities(self, velocities: Mapping[str, float] | ArrayLike) -> ArrayLike:
        """Return commanded velocities in the order of the joints, from a mapping by name.

        Raises:
            MachineError: an unknown joint name.
        """
        if not isinstance(velocities, Mapping):
            return velocities
        names = self.spec.joint_names
        unknown = sorted(str(name) for name in velocities if name not in names)
        if unknown:
            raise MachineError(
                f"unknown joint {', '.join(unknown)}; the joints are {', '.join(names)}"
            )
        return [velocities.get(name, 0.0) for name in names]

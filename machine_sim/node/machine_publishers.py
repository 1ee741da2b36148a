"""Publications of one machine: state, payload, visuals and sensors, each at its rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from machine_sim.commands import AppliedCommand
from machine_sim.machine.cylinder_visuals import cylinder_joint_states
from machine_sim.machine.description import DescriptionMeshes, description_text
from machine_sim.machine.forward_kinematics import link_frame_name, link_poses
from machine_sim.machine.track_wheels import BeltOdometer, track_wheels
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.params import MachineNodeParams
from machine_sim.node.reported_motion import ReportedMotion, TickProgress, VelocityScale
from machine_sim.sensors import SensorParams, Sensors
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.codec.machine_state import BaseState, JointValues, PayloadState, TrackValues
from msg_bridge.codec.poses import ToolWrench

if TYPE_CHECKING:  # only a node's own module loads rclpy
    from builtin_interfaces.msg import Time

    from machine_sim.node.sensor_publishers import SensorPublishers
    from machine_sim.node.state_publishers import StatePublishers

__all__ = ["MachinePublishers"]


class MachinePublishers:
    """One machine of a node and its topics.

    Attributes:
        instance: the machine.
    """

    def __init__(
        self,
        instance: MachineInstance,
        state_publishers: StatePublishers,
        sensor_publishers: SensorPublishers,
        sensor_params: SensorParams,
        frame_prefix: str,
        description_meshes: DescriptionMeshes,
    ) -> None:
        """
        Args:
            instance: the machine.
            state_publishers, sensor_publishers: its topics.
            sensor_params: rate and errors of its sensors.
            frame_prefix: prefix of each frame.
            description_meshes: shapes in the robot description; see `description_text`.
        """
        self.instance = instance
        self._state_publishers, self._sensor_publishers = state_publishers, sensor_publishers
        self._sensor_params, self._frame_prefix = sensor_params, frame_prefix
        self._description_meshes = description_meshes
        self._odometer = BeltOdometer(instance.spec)
        self._state_scale, self._sensor_scale = VelocityScale(), VelocityScale()

    def reset(self, seed: int, machine_index: int) -> None:
        """Reset what depends on earlier ticks, for a run.

        Args:
            seed: seed of the sensor errors.
            machine_index: index of the machine in the node.
        """
        spec = self.instance.spec
        self._state_scale, self._sensor_scale = VelocityScale(), VelocityScale()
        self._sensors = Sensors(spec, self._sensor_params, seed, machine_index)
        self._odometer = BeltOdometer(spec)

    def publish_description(self) -> None:
        """Publish the robot description."""
        spec = self.instance.spec
        urdf = description_text(spec, prefix=self._frame_prefix, meshes=self._description_meshes)
        self._state_publishers.publish_description(urdf)

    def publish_applied_command(self, command: AppliedCommand, stamp: Time) -> None:
        """Publish the command that takes effect in the tick that ends at `stamp`."""
        self._state_publishers.publish_applied_command(
            np.concatenate([command.joints, command.tracks]), stamp
        )

    def publish(
        self,
        simulated: SimulatedMachine,
        params: MachineNodeParams,
        is_due: Callable[[float], bool],
        progress: TickProgress,
        time: float,
        stamp: Time,
    ) -> None:
        """Publish those parts of the state that are due.

        Args:
            simulated: the machine in the present run.
            params: rates.
            is_due: returns whether a publication with a rate [Hz of simulated time] is due.
            progress: ticks made and passed so far.
            time: simulation time [s].
            stamp: simulation time.
        """
        machine = simulated.machine
        self._odometer.update(machine.tracks.travel.tolist())
        if is_due(params.state_rate):
            self._publish_state(simulated, self._state_scale.update(progress), time, stamp)
        if is_due(self._sensor_params.rate):
            scale = self._sensor_scale.update(progress)
            self._publish_sensors(ReportedMotion.of_machine(machine, scale), time, stamp)
        if is_due(params.transform_rate) or is_due(params.marker_rate):
            poses = link_poses(
                self.instance.spec,
                *machine.base_pose,
                machine.joint_positions,
                self._odometer.angles,
            )
            if is_due(params.transform_rate):
                self._state_publishers.publish_transforms(*poses, stamp)
            if is_due(params.marker_rate):
                self._state_publishers.publish_markers(poses, machine.tracks.shoe_poses, stamp)

    def _publish_state(
        self, simulated: SimulatedMachine, velocity_scale: float, time: float, stamp: Time
    ) -> None:
        machine = simulated.machine
        motion = ReportedMotion.of_machine(machine, velocity_scale)
        belt_speeds = velocity_scale * machine.tracks.speed
        self._state_publishers.publish_state(
            self._joint_values(motion, simulated, belt_speeds.tolist()),
            BaseState(*motion.base_pose, *motion.base_velocity),
            PayloadState(**simulated.payload._asdict(), time_s=time),
            {
                name: ToolWrench(*coupling.wrench, coupling.tool.pose[0])
                for name, coupling in simulated.couplings.items()
            },
            stamp,
        )
        cylinders = {
            joint: state._replace(speed=velocity_scale * state.speed)
            for joint, state in simulated.cylinders.items()
        }
        self._state_publishers.publish_cylinders(cylinders, time)
        tracks = machine.tracks
        columns = (tracks.slip, tracks.sinkage, belt_speeds, simulated.drive_forces)
        left, right = (TrackValues(*map(float, row)) for row in zip(*columns, strict=True))
        self._state_publishers.publish_tracks(left, right, time)

    def _publish_sensors(self, motion: ReportedMotion, time: float, stamp: Time) -> None:
        imus, encoders = self._sensors.read(motion, time)
        for imu in imus:
            values = (imu.quaternion, imu.angular_velocity, imu.specific_force)
            self._sensor_publishers.publish_imu(
                imu.name, link_frame_name(imu.frame), *values, stamp
            )
        self._sensor_publishers.publish_encoders(self.instance.spec.joint_names, *encoders)

    def _joint_values(
        self, motion: ReportedMotion, simulated: SimulatedMachine, belt_speeds: list[float]
    ) -> JointValues:
        """Return the values of the machine's joints, then of pistons, then of the sprockets."""
        spec = self.instance.spec
        angles, rates = motion.joint_positions, motion.joint_velocities
        pistons = cylinder_joint_states(spec, angles.tolist(), rates.tolist())
        sprockets = [wheel.joint for wheel in track_wheels(spec) if wheel.is_sprocket]
        radius = spec.tracks.sprocket_radius
        return JointValues(
            [*spec.joint_names, *pistons.names, *sprockets],
            [*angles, *pistons.positions, *self._odometer.angles],
            [*rates, *pistons.velocities, *(speed / radius for speed in belt_speeds)],
            [
                *simulated.joint_efforts,
                *[0.0] * len(pistons.names),
                *(radius * simulated.drive_forces),
            ],
        )

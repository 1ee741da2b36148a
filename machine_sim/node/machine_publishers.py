"""What one machine of a node tells: its state, load, looks and sensors, each when it is due."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from machine_sim.commands import AppliedCommand
from machine_sim.machine import TrackedMachine, urdf_text
from machine_sim.machine.cylinder_visuals import cylinder_joint_states
from machine_sim.machine.forward_kinematics import link_frame_name, link_poses
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.params import MachineNodeParams
from machine_sim.sensors import SensorParams, Sensors
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.codec.machine_state import BaseState, JointValues, PayloadState
from msg_bridge.codec.poses import ToolWrench

if TYPE_CHECKING:  # only a node's own module loads rclpy
    from builtin_interfaces.msg import Time

    from machine_sim.node.sensor_publishers import SensorPublishers
    from machine_sim.node.state_publishers import StatePublishers

__all__ = ["MachinePublishers"]


class MachinePublishers:
    """One machine of a node and its topics.

    Attributes:
        unit: the machine.
    """

    def __init__(
        self,
        unit: MachineInstance,
        topics: StatePublishers,
        sensor_topics: SensorPublishers,
        sensor_params: SensorParams,
        prefix: str,
    ) -> None:
        """
        Args:
            unit: the machine.
            topics, sensor_topics: what it is told on.
            sensor_params: rate and errors of its sensors.
            prefix: put before each frame's name.
        """
        self.instance = unit
        self._state_publishers, self._sensor_publishers = topics, sensor_topics
        self._sensor_params, self._prefix = sensor_params, prefix

    def start_run(self, seed: int, machine_index: int) -> None:
        """Begin a run: say what the machine is.

        Args:
            seed: of the errors of its sensors.
            number: of the machine among those of the node.
        """
        spec = self.instance.spec
        self._sensors = Sensors(spec, self._sensor_params, seed, machine_index)
        urdf = urdf_text(spec, prefix=self._prefix, virtual_base=True, include_cylinders=True)
        self._state_publishers.publish_description(urdf)

    def publish_applied_command(self, command: AppliedCommand, stamp: Time) -> None:
        """Tell the command that takes effect in the tick that ends at `stamp`."""
        self._state_publishers.publish_applied_command(
            np.concatenate([command.joints, command.tracks]), stamp
        )

    def publish(
        self,
        rig: SimulatedMachine,
        params: MachineNodeParams,
        is_due: Callable[[float], bool],
        time: float,
        stamp: Time,
    ) -> None:
        """Tell how the machine is.

        Args:
            rig: the machine at work.
            params: how often what is told.
            due: whether what is told so many times a simulated second is due now.
            time: simulation time [s].
            stamp: the same.
        """
        machine = rig.machine
        if is_due(params.state_rate):
            self._publish_state(rig, time, stamp)
        if is_due(self._sensor_params.rate):
            self._publish_sensors(machine, time, stamp)
        if is_due(params.transform_rate) or is_due(params.marker_rate):
            pose = (*machine.base_pose, machine.joint_positions)
            poses = link_poses(self.instance.spec, *pose)
            if is_due(params.transform_rate):
                self._state_publishers.publish_transforms(*poses, stamp)
            if is_due(params.marker_rate):
                self._state_publishers.publish_markers(poses, machine.tracks.shoe_poses, stamp)

    def diagnostics(self, rig: SimulatedMachine) -> dict[str, Any]:
        """What `/diagnostics` says of the machine at work."""
        values = {
            "payload_fill": f"{rig.payload.fill:.3f}",
            "emergency_stop": self.instance.arbiter.is_stopped,
            "tilt_rad": f"{rig.machine.tilt:.3f}",
            "overturned": rig.machine.overturned,
        }
        return {self.instance.topic_prefix + key: value for key, value in values.items()}

    def _publish_state(self, rig: SimulatedMachine, time: float, stamp: Time) -> None:
        machine = rig.machine
        self._state_publishers.publish_state(
            self._joint_values(machine),
            BaseState(*machine.base_pose, *machine.base_velocity),
            PayloadState(**asdict(rig.payload), time=time),
            {
                name: ToolWrench(*work.wrench, work.tool.pose[0])
                for name, work in rig.couplings.items()
            },
            stamp,
        )
        self._state_publishers.publish_cylinders(machine.cylinders, time)

    def _publish_sensors(self, machine: TrackedMachine, time: float, stamp: Time) -> None:
        imus, encoders = self._sensors.read(machine, time)
        for imu in imus:
            told = (imu.quaternion, imu.angular_velocity, imu.specific_force)
            self._sensor_publishers.publish_imu(imu.name, link_frame_name(imu.frame), *told, stamp)
        self._sensor_publishers.publish_encoders(self.instance.spec.joint_names, *encoders)

    def _joint_values(self, machine: TrackedMachine) -> JointValues:
        """All joints: the machine's own, then those of the pistons, which only follow."""
        spec = self.instance.spec
        angles, rates = machine.joint_positions, machine.joint_velocities
        pistons = cylinder_joint_states(spec, angles.tolist(), rates.tolist())
        return JointValues(
            [*spec.joint_names, *pistons.names],
            [*angles, *pistons.positions],
            [*rates, *pistons.velocities],
            [*machine.joint_efforts, *[0.0] * len(pistons.names)],
        )

"""What one machine of a node tells: its state, load, looks and sensors, each when it is due."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from machine_sim.commands import AppliedCommand
from machine_sim.machine import TrackedMachine, urdf_text
from machine_sim.machine.appearance import frame_of, link_poses
from machine_sim.machine.pistons import piston_joints
from machine_sim.node_params import MachineNodeParams
from machine_sim.sensors import SensorParams, Sensors
from machine_sim.unit import Unit
from machine_sim.work.rig import Rig
from msg_bridge.codec.machine_state import BaseState, JointValues, PayloadState
from msg_bridge.codec.poses import ToolWrench

if TYPE_CHECKING:  # only a node's own module loads rclpy
    from builtin_interfaces.msg import Time

    from msg_bridge.nodes.machine_topics import MachineTopics
    from msg_bridge.nodes.sensor_topics import SensorTopics

__all__ = ["Station"]


class Station:
    """One machine of a node and its topics.

    Attributes:
        unit: the machine.
    """

    def __init__(
        self,
        unit: Unit,
        topics: MachineTopics,
        sensor_topics: SensorTopics,
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
        self.unit = unit
        self._topics, self._sensor_topics = topics, sensor_topics
        self._sensor_params, self._prefix = sensor_params, prefix

    def begin(self, seed: int, number: int) -> None:
        """Begin a run: say what the machine is.

        Args:
            seed: of the errors of its sensors.
            number: of the machine among those of the node.
        """
        description = self.unit.description
        self._sensors = Sensors(description, self._sensor_params, seed, number)
        urdf = urdf_text(description, prefix=self._prefix, virtual_base=True, pistons=True)
        self._topics.describe(urdf)

    def applied(self, command: AppliedCommand, stamp: Time) -> None:
        """Tell the command that takes effect in the tick that ends at `stamp`."""
        self._topics.applied(np.concatenate([command.joints, command.tracks]), stamp)

    def tell(
        self,
        rig: Rig,
        params: MachineNodeParams,
        due: Callable[[float], bool],
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
        if due(params.state_rate):
            self._tell_state(rig, time, stamp)
        if due(self._sensor_params.rate):
            self._tell_sensors(machine, time, stamp)
        if due(params.transform_rate) or due(params.marker_rate):
            pose = (*machine.base_pose, machine.joint_positions)
            poses = link_poses(self.unit.description, *pose)
            if due(params.transform_rate):
                self._topics.transforms(*poses, stamp)
            if due(params.marker_rate):
                self._topics.markers(poses, machine.tracks.shoe_poses, stamp)

    def diagnosis(self, rig: Rig) -> dict[str, Any]:
        """What `/diagnostics` says of the machine at work."""
        values = {
            "payload_fill": f"{rig.payload.fill:.3f}",
            "emergency_stop": self.unit.board.stopped,
            "tilt_rad": f"{rig.machine.tilt:.3f}",
            "overturned": rig.machine.overturned,
        }
        return {self.unit.folder + key: value for key, value in values.items()}

    def _tell_state(self, rig: Rig, time: float, stamp: Time) -> None:
        machine = rig.machine
        self._topics.state(
            self._joint_values(machine),
            BaseState(*machine.base_pose, *machine.base_velocity),
            PayloadState(**asdict(rig.payload), time=time),
            {name: ToolWrench(*work.wrench, work.tool.pose[0]) for name, work in rig.tools.items()},
            stamp,
        )
        self._topics.cylinders(machine.cylinders, time)

    def _tell_sensors(self, machine: TrackedMachine, time: float, stamp: Time) -> None:
        imus, encoders = self._sensors.read(machine, time)
        for imu in imus:
            told = (imu.quaternion, imu.spin, imu.specific_force)
            self._sensor_topics.imu(imu.name, frame_of(imu.frame), *told, stamp)
        self._sensor_topics.encoders(self.unit.description.joint_names, *encoders)

    def _joint_values(self, machine: TrackedMachine) -> JointValues:
        """All joints: the machine's own, then those of the pistons, which only follow."""
        description = self.unit.description
        angles, rates = machine.joint_positions, machine.joint_velocities
        pistons = piston_joints(description, angles.tolist(), rates.tolist())
        return JointValues(
            [*description.joint_names, *pistons.names],
            [*angles, *pistons.positions],
            [*rates, *pistons.velocities],
            [*machine.joint_efforts, *[0.0] * len(pistons.names)],
        )

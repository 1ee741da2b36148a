"""Handlers of the topics of machines and their operators."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from earthmoving_sim.run_report.run_data import (
    Handler,
    MachineData,
    PhaseChange,
    TopicHandlers,
    labelled,
)
from msg_bridge.codec.rotations import rotation_matrix, yaw_pitch_roll
from msg_bridge.contract import topics

__all__ = ["MachineHandlers"]

_NANO = 1e-9
_SWING = "swing"
_TURNS = ("base_", "_pin", "_stroke")
"""Parts of the names of joints that are no drives: the virtual ones of the base, and linkages."""

_COMMANDS = {
    topics.JOINT_COMMANDS: "JointState",
    topics.FRONT_VELOCITY_COMMANDS: "Float64MultiArray",
    topics.TRACK_VELOCITY_COMMANDS: "Float64MultiArray",
    topics.CMD_VEL: "TwistStamped",
    topics.JOY: "Joy",
}
"""Types of the command topics."""


class MachineHandlers(TopicHandlers):
    """Handlers of the topics of machines and their operators."""

    def find(self, topic: str, kind: str) -> Handler | None:
        """Return the handler of a topic; see `TopicHandlers`."""
        handlers: dict[tuple[str, str], Callable[[str], Handler]] = {
            (topics.PAYLOAD, "Float64MultiArray"): self._on_payload,
            (topics.JOINT_STATES, "JointState"): self._on_joints,
            (topics.APPLIED_COMMANDS, "JointState"): self._on_applied,
            (topics.CYLINDERS, "Float64MultiArray"): self._on_cylinders,
            (topics.TRACKS, "Float64MultiArray"): self._on_tracks,
            (topics.ODOM, "Odometry"): self._on_odometry,
            (topics.OPERATOR_PHASE, "String"): self._on_phase,
            (topics.OPERATOR_CYCLES, "String"): self._on_report,
            **{
                (name, type_name): lambda machine: self._on_command(machine, topic)
                for name, type_name in _COMMANDS.items()
            },
        }
        for (name, type_name), make in handlers.items():
            machine = topic.removesuffix(f"/{name}")
            if machine != topic and kind == type_name:
                return make(machine)
        if kind == "WrenchStamped":
            machine, _, tool = topic.removesuffix("/wrench").rpartition("/")
            return self._on_wrench(machine, tool)
        return None

    def _machine(self, namespace: str) -> MachineData:
        return self._reading.run.machines[namespace]

    def _on_payload(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            values, data = labelled(message), self._machine(machine)
            time = (
                values["time_s"] if self._reading.is_simulation else self._reading.seconds(log_time)
            )
            data.payload.add(time, values["bank_m3"])
            data.fill.add(time, values.get("fill", math.nan))

        return handle

    def _on_joints(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            time, data = self._reading.time(message.header.stamp, log_time), self._machine(machine)
            for values, traces in (
                (message.position, data.positions),
                (message.velocity, data.velocities),
                (message.effort, data.efforts),
            ):
                for name, value in zip(message.name, values, strict=False):
                    if name == _SWING and traces is data.velocities:
                        data.swing.add(time, value)
                    if not any(part in name for part in _TURNS):
                        traces[name].add(time, value)

        return handle

    def _on_applied(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            time, data = self._reading.time(message.header.stamp, log_time), self._machine(machine)
            for name, value in zip(message.name, message.velocity, strict=False):
                data.commands[name].add(time, value)
            applied = dict(zip(message.name, message.velocity, strict=False))
            data.latency.add_applied(applied, log_time * _NANO, time)

        return handle

    def _on_command(self, machine: str, topic: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            values, stamp = _command_values(message)
            time = None
            if stamp is not None and (stamp.sec or stamp.nanosec):
                time = float(stamp.sec) + _NANO * float(stamp.nanosec)
            self._machine(machine).latency.add_command(
                topic, values, log_time * _NANO, time, _velocities(message)
            )

        return handle

    def _on_cylinders(self, machine: str) -> Handler:
        return self._onlabelled(lambda: self._machine(machine).cylinders)

    def _on_tracks(self, machine: str) -> Handler:
        return self._onlabelled(lambda: self._machine(machine).tracks)

    def _onlabelled(self, traces: Callable[[], Any]) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            values, found = labelled(message), traces()
            time = values.get("time_s", self._reading.seconds(log_time))
            for name, value in values.items():
                if name != "time_s":
                    found[name].add(time, value)

        return handle

    def _on_odometry(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            time, data = self._reading.time(message.header.stamp, log_time), self._machine(machine)
            pose = message.pose.pose
            data.way.add(pose.position.x, pose.position.y)
            q = pose.orientation
            _, pitch, roll = yaw_pitch_roll(rotation_matrix((q.x, q.y, q.z, q.w)))
            data.tilt["pitch"].add(time, pitch)
            data.tilt["roll"].add(time, roll)

        return handle

    def _on_wrench(self, machine: str, tool: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            force = message.wrench.force
            time = self._reading.time(message.header.stamp, log_time)
            self._machine(machine).forces[tool].add(time, math.hypot(force.x, force.y, force.z))

        return handle

    def _on_phase(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            found = json.loads(message.data)
            phase = PhaseChange(float(found["time"]), int(found["cycle"]), str(found["phase"]))
            phases = self._machine(machine).phases
            if not phases or phases[-1].phase != phase.phase or phases[-1].cycle != phase.cycle:
                phases.append(phase)

        return handle

    def _on_report(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            found = json.loads(message.data)
            if not isinstance(found, dict):
                raise TypeError("a report is a JSON object")
            self._machine(machine).reports.append(found)

        return handle


def _command_values(message: Any) -> tuple[tuple[float, ...], Any]:
    """Return all numbers of a command, and its stamp if it has one."""
    header = getattr(message, "header", None)
    stamp = None if header is None else header.stamp
    if hasattr(message, "data"):
        return tuple(message.data), stamp
    if hasattr(message, "twist"):
        return (message.twist.linear.x, message.twist.angular.z), stamp
    if hasattr(message, "axes"):
        return (*message.axes, *message.buttons), stamp
    return (*message.velocity, *message.position), stamp


def _velocities(message: Any) -> dict[str, float]:
    """Return the commanded velocities by joint or track; empty for commands of another kind."""
    names, velocities = getattr(message, "name", ()), getattr(message, "velocity", ())
    return dict(zip(names, velocities, strict=True)) if len(names) == len(velocities) else {}

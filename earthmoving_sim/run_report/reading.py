"""One pass over a bag, which fills the data of a run."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import yaml

from earthmoving_sim.run_report.run_data import Handler, MachineData, PhaseChange, Problem, RunData
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.labelled_array import array_label
from msg_bridge.codec.rotations import rotation_matrix, yaw_pitch_roll
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["read_runs"]

_NANO = 1e-9
_MM3 = 1e-9
_PROGRESS_INTERVAL = 2000  # messages
_SWING = "swing"
_TURNS = ("base_", "_pin", "_stroke")
"""Parts of the names of joints that are no drives: the virtual ones of the base, and linkages."""

_ACCOUNTS = ("in_flight", "pending", "particles", "absent", "outside")
_NO_PROBLEM = ("ok", "")


def read_runs(
    reader: BagReader,
    *,
    run_id: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[RunData, list[int]]:
    """Return the data of one run of a bag, and the numbers of all its runs.

    Args:
        reader: the bag.
        run_id: number of the run; None: the last one.
        progress: is called with the fraction that has been read.

    Raises:
        BagReadError: the bag is damaged.
    """
    reading = _Reading(reader, run_id)
    wanted = list(reading.handlers)
    total = sum(reader.topics[name].count for name in wanted)
    for number, (topic, time, data) in enumerate(reader.raw_messages(wanted)):
        reading.add(topic, data, time)
        if progress is not None and number % _PROGRESS_INTERVAL == 0:
            progress(number / max(total, 1))
    if progress is not None:
        progress(1.0)
    return reading.run, reading.run_ids


class _Reading:
    """Handlers of the topics, and the run that is read.

    Attributes:
        run: its data.
        run_ids: numbers of all runs so far.
        handlers: by topic.
    """

    def __init__(self, reader: BagReader, run_id: int | None) -> None:
        self.run = RunData()
        self.run_ids: list[int] = []
        self._reader, self._wanted_id = reader, run_id
        self._present_id: int | None = None
        self._is_simulation = f"/{topics.SOIL_TICK}" in reader.topics
        self.handlers: dict[str, Handler] = {}
        for name, info in reader.topics.items():
            handler = self._handler(name, info.type.rpartition("/")[2])
            if handler is not None and reader.is_of_simulation(name):
                self.handlers[name] = handler

    def add(self, topic: str, data: bytes, log_time: int) -> None:
        """Handle a message; one that cannot be read is counted."""
        try:
            message = self._reader.decode(topic, data, log_time)
            if topic == f"/{topics.SIM_CONFIG}":
                self._begin_run(message)
            if self._wanted_id is not None and self._present_id not in (self._wanted_id, None):
                return
            self.run.first_log = log_time if self.run.first_log is None else self.run.first_log
            self.run.last_log = log_time
            self.handlers[topic](message, log_time)
        except (EarthmovingError, ValueError, TypeError, KeyError, IndexError, yaml.YAMLError):
            self.run.malformed[topic] += 1

    def _begin_run(self, message: Any) -> None:
        """Begin with empty data if a configuration is that of another run."""
        run_id = int(yaml.safe_load(message.data)["run"]["run_id"])
        self._present_id = run_id
        if run_id not in self.run_ids:
            self.run_ids.append(run_id)
        is_wanted = self._wanted_id in (None, run_id)
        if is_wanted and self.run.run_id not in (None, run_id):
            self.run = RunData()
        if is_wanted:
            self.run.run_id = run_id

    def _seconds(self, log_time: int) -> float:
        """Return the time since the first message of the run [s]."""
        return (log_time - (self.run.first_log or log_time)) * _NANO

    def _time(self, stamp: Any, log_time: int) -> float:
        """Return the simulation time of a message [s]; without a simulation, its log time."""
        if not self._is_simulation:
            return self._seconds(log_time)
        time = float(stamp.sec) + _NANO * float(stamp.nanosec)
        self.run.note_time(time)
        return time

    def _handler(self, topic: str, kind: str) -> Handler | None:
        """Return the handler of a topic; None if it is not read."""
        of_soil: dict[tuple[str, str], Handler] = {
            (topics.SIM_CONFIG, "String"): self._on_config(topic),
            (topics.TERRAIN_MAP, "PointCloud2"): self._on_map,
            (topics.TERRAIN_MAP_UPDATES, "PointCloud2"): self._on_map_updates,
            (topics.SOIL_CONVERSIONS, "PointCloud2"): self._on_conversions,
            (topics.SOIL_LEDGER, "Int64MultiArray"): self._on_ledger,
            (topics.SOIL_CUT_FILL, "Float64MultiArray"): self._on_cut_fill,
            (topics.SOIL_JOIN_REJECTIONS, "String"): self._on_rejection,
            (topics.SIM_PAUSED, "Bool"): self._on_paused,
            (topics.DIAGNOSTICS, "DiagnosticArray"): self._on_diagnostics,
        }
        for (name, type_name), handler in of_soil.items():
            if topic == f"/{name}" and kind == type_name:
                return handler
        of_machine: dict[tuple[str, str], Callable[[str], Handler]] = {
            (topics.MACHINE_CONFIG, "String"): lambda _: self._on_config(topic),
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
        for (name, type_name), make in of_machine.items():
            machine = topic.removesuffix(f"/{name}")
            if machine != topic and kind == type_name:
                return make(machine)
        if kind == "WrenchStamped":
            machine, _, tool = topic.removesuffix("/wrench").rpartition("/")
            return self._on_wrench(machine, tool)
        return None

    # Soil.

    def _on_config(self, topic: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            content = yaml.safe_load(message.data)
            if isinstance(content, dict):
                self.run.configs[topic.rpartition("/")[0]] = content

        return handle

    def _on_map(self, message: Any, log_time: int) -> None:
        terrain = from_terrain_cloud(message)
        if self.run.run_id in (None, terrain.keyframe.run_id):
            self.run.terrain.add_map(terrain)

    def _on_map_updates(self, message: Any, log_time: int) -> None:
        chunk = from_chunk_cloud(message, Stream.MAP_UPDATE)
        if self.run.run_id in (None, chunk.run_id):
            self.run.terrain.add_updates(chunk.rows)

    def _on_conversions(self, message: Any, log_time: int) -> None:
        chunk = from_chunk_cloud(message, Stream.CONVERSION)
        if self.run.run_id not in (None, chunk.run_id):
            return
        rows = chunk.rows[chunk.rows["seq"].astype(np.int64) > self._last_row]
        if not rows.size:
            return  # sent again
        self.run.volumes.last_row = int(rows["seq"][-1])
        time = self._time(message.header.stamp, log_time)
        for kind, totals in (
            (ConversionKind.EXCAVATE, self.run.excavated),
            (ConversionKind.DEPOSIT, self.run.deposited),
        ):
            of_kind = rows[rows["kind"] == kind]
            for machine_id in np.unique(of_kind["machine_id"]).tolist():
                volumes = of_kind["volume_mm3"][of_kind["machine_id"] == machine_id]
                self.run.volumes.add(totals, machine_id, time, int(volumes.sum(dtype=np.int64)))

    @property
    def _last_row(self) -> int:
        return self.run.volumes.last_row

    def _on_ledger(self, message: Any, log_time: int) -> None:
        values = _labelled(message)
        if self.run.run_id not in (None, int(values["run_id"])):
            return
        time = values["stamp_sec"] + _NANO * values["stamp_nanosec"]
        self.run.note_time(time)
        self.run.clock.add(self._seconds(log_time), time)
        for name in _ACCOUNTS:
            self.run.accounts[name].add(time, values.get(name, 0.0) * _MM3)
        self.run.accounts["terrain"].add(time, (values["terrain"] - values["start"]) * _MM3)
        self.run.imbalance.add(time, values["imbalance"])

    def _on_cut_fill(self, message: Any, log_time: int) -> None:
        values = _labelled(message)
        for name, value in values.items():
            if name != "time_s":
                self.run.design[name].add(values.get("time_s", self._seconds(log_time)), value)

    def _on_rejection(self, message: Any, log_time: int) -> None:
        self.run.rejections.append(str(json.loads(message.data)["reason"]))

    def _on_paused(self, message: Any, log_time: int) -> None:
        if not self.run.paused or self.run.paused[-1][1] != message.data:
            self.run.paused.append((self._seconds(log_time), bool(message.data)))

    def _on_diagnostics(self, message: Any, log_time: int) -> None:
        for status in message.status:
            name = status.name.partition(":")[0]
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            if level and status.message not in _NO_PROBLEM:
                self.run.problems[Problem(name, level, status.message)] += 1
            values = {each.key: each.value for each in status.values}
            self.run.diagnostics[name] = values
            if "late_ticks" in values and "imbalance_mm3" in values:
                seconds = self._seconds(log_time)
                self.run.late_ticks.add(seconds, float(values["late_ticks"]))
                self.run.real_time_factor.add(seconds, float(values["real_time_factor"]))

    # Machines.

    def _machine(self, namespace: str) -> MachineData:
        return self.run.machines[namespace]

    def _on_payload(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            values, data = _labelled(message), self._machine(machine)
            time = values["time_s"] if self._is_simulation else self._seconds(log_time)
            data.payload.add(time, values["bank_m3"])
            data.fill.add(time, values.get("fill", math.nan))

        return handle

    def _on_joints(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            time, data = self._time(message.header.stamp, log_time), self._machine(machine)
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
            time, data = self._time(message.header.stamp, log_time), self._machine(machine)
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
        return self._on_labelled(lambda: self._machine(machine).cylinders)

    def _on_tracks(self, machine: str) -> Handler:
        return self._on_labelled(lambda: self._machine(machine).tracks)

    def _on_labelled(self, traces: Callable[[], Any]) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            values, found = _labelled(message), traces()
            time = values.get("time_s", self._seconds(log_time))
            for name, value in values.items():
                if name != "time_s":
                    found[name].add(time, value)

        return handle

    def _on_odometry(self, machine: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            time, data = self._time(message.header.stamp, log_time), self._machine(machine)
            pose = message.pose.pose
            data.path[0].add(time, pose.position.x)
            data.path[1].add(time, pose.position.y)
            q = pose.orientation
            _, pitch, roll = yaw_pitch_roll(rotation_matrix((q.x, q.y, q.z, q.w)))
            data.tilt["pitch"].add(time, pitch)
            data.tilt["roll"].add(time, roll)

        return handle

    def _on_wrench(self, machine: str, tool: str) -> Handler:
        def handle(message: Any, log_time: int) -> None:
            force = message.wrench.force
            time = self._time(message.header.stamp, log_time)
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


_COMMANDS = {
    topics.JOINT_COMMANDS: "JointState",
    topics.FRONT_VELOCITY_COMMANDS: "Float64MultiArray",
    topics.TRACK_VELOCITY_COMMANDS: "Float64MultiArray",
    topics.CMD_VEL: "TwistStamped",
    topics.JOY: "Joy",
}
"""Types of the command topics."""


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


def _labelled(message: Any) -> dict[str, float]:
    """Return the values of a labelled array by name.

    Raises:
        CodecError: it has no labels.
    """
    return dict(zip(array_label(message).split(","), message.data, strict=True))

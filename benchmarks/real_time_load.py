"""Measure real time over DDS: late ticks, real-time factor and load, for machines that dig.

    python -m benchmarks.real_time_load                        # 1 and 2 machines, all cores
    python -m benchmarks.real_time_load --machines 1 --cores 1 # soil and machine on one core
    python -m benchmarks.real_time_load --machines 1 --drive --track-model dynamic

A soil node and machine nodes are separate processes. Each machine repeats a scripted dig cycle of
8 s: it drags its bucket through the ground, lifts it, swings, dumps and swings back. With `--drive`
it stands on rough ground and drives between its digs: ahead, on the spot, back, in a curve. A tick
is late if it ended more than half a period after its time, or if the clock was slowed down for it.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from earthmoving_sim.multi_process.node_process import NodeProcess, stop_all
from machine_sim.machine import MachineSpec, load_machine_spec
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel
from msg_bridge.codec import qos
from msg_bridge.config_files import find_config
from msg_bridge.contract import topics
from msg_bridge.dds_profile import use_shipped_profile

COLUMNS = (
    Column("late ticks", "%", ".1f"),
    Column("real-time factor", "", ".2f"),
    Column("soil CPU", "%", ".0f"),
    Column("machine CPU", "%", ".0f"),
    Column("particles", "", ".0f"),
)
SPACING = 14.0
"""Distance between neighbouring machines [m]."""
COMMAND_PERIOD = 0.05
"""Simulation time between commands [s]."""
START_TIMEOUT = 180.0
"""Maximum wall time until the first tick, compilation included [s]."""
CYCLE_TIME = 8.0
"""Simulation time of a dig cycle [s]."""
DRIVE_TIMES = (3.5, 7.5)
"""Start and end of driving in a cycle [s]."""
FLAT_SITE: Mapping[str, object] = {"terrain": "flat", "num_points": 257, "cell": 0.2}

TRACK_SPEEDS = ((0.8, 0.8), (-0.5, 0.5), (-0.8, -0.8), (0.6, 0.2))
"""Speeds of the left and the right track in successive cycles [m/s]."""


class LoadResult(NamedTuple):
    """Result of one run in real time.

    Attributes:
        late_percent: late ticks of all ticks [%].
        real_time_factor: simulation time over wall time.
        soil_cpu_percent: CPU time of the soil node over wall time [%].
        machine_cpu_percent: the same of all machine nodes, their mean [%].
        max_particles: maximum number of particles of one machine.
    """

    late_percent: float
    real_time_factor: float
    soil_cpu_percent: float
    machine_cpu_percent: float
    max_particles: float


def main() -> None:
    """Measure and print a row for each number of machines."""
    parser = make_parser(__doc__, runs=3)
    parser.add_argument("--machines", type=int, nargs="+", default=[1, 2], help="machine nodes")
    parser.add_argument("--seconds", type=float, default=24.0, help="wall time of a run (24)")
    parser.add_argument("--drive", action="store_true", help="rough ground, drive between digs")
    parser.add_argument(
        "--track-model", choices=TRACK_MODELS, default="kinematic", help="model of the tracks"
    )
    parser.add_argument("--cores", type=int, help="number of cores for all nodes (all)")
    parser.add_argument(
        "--num-points", type=int, default=257, help="rows and columns of the terrain (257)"
    )
    options = parser.parse_args()
    if options.cores:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    table.print_header("machines")
    for count in options.machines:
        results = [
            run_machines(
                count,
                options.seconds,
                options.track_model,
                drives=options.drive,
                num_points=options.num_points,
            )
            for _ in range(options.runs)
        ]
        medians = [statistics.median(values) for values in zip(*results, strict=True)]
        late = ", ".join(f"{result.late_percent:.1f}" for result in results)
        table.print_row(f"{count} x excavator", medians, remark=f"late: {late}")


def run_machines(
    count: int,
    seconds: float,
    track_model: TrackModel = "kinematic",
    *,
    drives: bool = False,
    num_points: int = 257,
) -> LoadResult:
    """Run a soil node and some machine nodes that dig, for some seconds of wall time.

    Args:
        count: number of machines.
        seconds: wall time [s].
        track_model: model of their tracks.
        drives: whether they drive between digs, on rough ground.
        num_points: rows and columns of the terrain.
    """
    with tempfile.TemporaryDirectory() as folder:
        script = DriveAndDigScript if drives else DigScript
        terrain = "rough" if drives else "flat"
        site = {"terrain": terrain, "num_points": num_points, "cell": 0.2}
        run = DiggingNodes(Path(folder), count, script, site=site, track_model=track_model)
        try:
            run.spin_until(lambda: run.sim_time > 2.0, START_TIMEOUT)
            before = run.sample()
            run.spin_until(lambda: time.monotonic() - before.wall > seconds, seconds + 5.0)
            after = run.sample()
        finally:
            run.stop()
    wall = after.wall - before.wall
    return LoadResult(
        100.0 * (after.num_late - before.num_late) / max(after.tick - before.tick, 1),
        (after.sim_time - before.sim_time) / wall,
        100.0 * (after.soil_cpu - before.soil_cpu) / wall,
        100.0 * (after.machine_cpu - before.machine_cpu) / wall / count,
        after.particles,
    )


class Sample(NamedTuple):
    """State of a run at one time."""

    wall: float
    sim_time: float
    tick: float
    num_late: float
    soil_cpu: float
    machine_cpu: float
    particles: float


class DiggingNodes:
    """Nodes in processes of their own, and the scripts that command the machines.

    Attributes:
        sim_time: simulation time of the newest state [s].
        max_delay: largest time by which a tick began late, until it is set to 0 [ms].
        soil, machines: the processes.
        node: node of the benchmark.
    """

    def __init__(
        self,
        folder: Path,
        count: int,
        make_script: Callable[[MachineSpec], DigScript] | None = None,
        *,
        site: Mapping[str, object] = FLAT_SITE,
        track_model: TrackModel = "kinematic",
    ) -> None:
        """Start soil and machines.

        Args:
            folder: folder for parameters and logs.
            count: number of machines.
            make_script: makes the script of a machine; None: a `DigScript`.
            site: parameters of the terrain.
            track_model: model of the tracks.
        """
        make_script = make_script or DigScript
        spec = load_machine_spec(find_config("machines/excavator.yaml"))
        names = [f"excavator_{k + 1}" for k in range(count)]
        parameters = folder / "parameters.yaml"
        content = _parameters(spec, names, folder, site, track_model)
        parameters.write_text(yaml.safe_dump(content))
        use_shipped_profile()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.sim_time = self._max_particles = 0.0
        self._values: dict[str, float] = {}
        self.max_delay = 0.0
        self.node = Node("real_time_load")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._store, 10)
        for name in names:
            self._command(name, make_script(spec))
        arguments = ["--ros-args", "--params-file", str(parameters)]
        self.soil = NodeProcess(
            "soil_sim", "soil_sim.node.soil_node", arguments, folder / "soil_sim.log"
        )
        self.machines = [
            NodeProcess(
                name,
                "machine_sim.node.machine_node",
                [*arguments, "-r", f"__ns:=/{name}"],
                folder / f"{name}.log",
            )
            for name in names
        ]

    def stop(self) -> None:
        """Stop all processes."""
        stop_all([*self.machines, self.soil])
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def spin_until(self, condition: object, timeout: float) -> None:
        """Process messages until a condition holds.

        Raises:
            TimeoutError: it does not hold after `timeout` [s].
        """
        assert callable(condition)
        deadline = time.monotonic() + timeout
        while not condition():
            for process in (self.soil, *self.machines):
                process.check()
            if time.monotonic() > deadline:
                raise TimeoutError(f"no result after {timeout:g} s")
            self._executor.spin_once(timeout_sec=0.05)

    def sample(self) -> Sample:
        """Return the state at the next diagnostics of the soil node."""
        self._values.clear()
        self.spin_until(lambda: "late_ticks" in self._values, 30.0)
        return Sample(
            time.monotonic(),
            self._values["sim_time"],
            self._values["tick"],
            self._values["late_ticks"],
            self.soil.cpu_time,
            sum(process.cpu_time for process in self.machines),
            self._max_particles,
        )

    def _command(self, name: str, script: DigScript) -> None:
        """Command a machine by a script whenever it publishes its state."""
        publisher = self.node.create_publisher(JointState, f"/{name}/joint_commands", qos.STATE)
        tracks = self.node.create_publisher(
            Float64MultiArray, f"/{name}/{topics.TRACK_VELOCITY_COMMANDS}", qos.STATE
        )

        def command(state: JointState) -> None:
            self.sim_time = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
            goal = script.goal(self.sim_time).tolist()
            publisher.publish(JointState(name=["swing", "boom", "arm", "bucket"], position=goal))
            tracks.publish(Float64MultiArray(data=script.track_speeds(self.sim_time)))

        self.node.create_subscription(JointState, f"/{name}/joint_states", command, qos.STATE)

    def _store(self, msg: DiagnosticArray) -> None:
        """Keep the latest values of the soil node and the maximum number of particles."""
        for status in msg.status:
            values = {pair.key: pair.value for pair in status.values}
            if "late_ticks" in values and "imbalance_mm3" in values:
                self._values["tick"] = float(values["tick"])
                self._values["sim_time"] = 0.01 * float(values["tick"])
                self._values["late_ticks"] = float(values["late_ticks"])
                self.max_delay = max(self.max_delay, float(values["max_delay_ms"]))
            elif "particles" in values:
                self._max_particles = max(self._max_particles, float(values["particles"]))


class DigScript:
    """Joint angles of an endless dig cycle by simulation time."""

    def __init__(self, spec: MachineSpec) -> None:
        """Prepare the poses of the cycle."""
        origin = float(arm_geometry(spec).swing[2])

        def pose(swing: float, reach: float, height: float, attitude: float) -> list[float]:
            return [swing, *solve_arm_angles(spec, reach, height - origin, attitude)]

        times_and_poses = [
            (0.0, pose(0.0, 7.0, 0.1, 2.0)),
            (1.0, pose(0.0, 6.6, -0.35, 2.1)),
            (3.0, pose(0.0, 5.4, -0.35, 2.5)),
            (4.0, pose(0.0, 5.0, 1.2, 3.2)),
            (5.5, pose(1.0, 5.5, 1.5, 3.2)),
            (6.2, pose(1.0, 6.0, 1.5, 1.6)),
            (6.6, pose(1.0, 6.0, 1.5, 1.6)),
            (CYCLE_TIME, pose(0.0, 7.0, 0.1, 2.0)),
        ]
        self._times = np.array([each for each, _ in times_and_poses])
        self._poses = np.array([each for _, each in times_and_poses])

    def goal(self, sim_time: float) -> np.ndarray:
        """Return the angles of swing, boom, arm and bucket [rad], shape (4,)."""
        phase = sim_time % CYCLE_TIME
        return np.array([np.interp(phase, self._times, angles) for angles in self._poses.T])

    def track_speeds(self, sim_time: float) -> list[float]:
        """Return the speeds of the left and the right track [m/s]."""
        return [0.0, 0.0]


class DriveAndDigScript(DigScript):
    """The dig cycle; the machine drives while the arm swings back."""

    def track_speeds(self, sim_time: float) -> list[float]:
        """Return the speeds of the left and the right track [m/s]."""
        cycle, phase = divmod(sim_time, CYCLE_TIME)
        if not DRIVE_TIMES[0] < phase < DRIVE_TIMES[1]:
            return [0.0, 0.0]
        return list(TRACK_SPEEDS[int(cycle) % len(TRACK_SPEEDS)])


def _parameters(
    spec: MachineSpec,
    names: list[str],
    folder: Path,
    site: Mapping[str, object],
    track_model: TrackModel,
) -> dict[str, object]:
    """Return the parameters of all nodes."""
    content = yaml.safe_load(find_config("machines/excavator.yaml").read_text())
    home = dict(zip(spec.joints, map(float, DigScript(spec).goal(0.0)), strict=True))
    machine_file = folder / "ready.yaml"
    machine_file.write_text(yaml.safe_dump({**content, "home": home}, sort_keys=False))
    soil = {
        "sync": "realtime",
        "expected_machines": [k + 1 for k in range(len(names))],
        "machine_timeout": 60.0,
        "site": dict(site),
    }
    nodes = {"/soil_sim": soil}
    for k, name in enumerate(names):
        nodes[f"/{name}/machine_sim"] = {
            "machine": str(machine_file),
            "machine_id": k + 1,
            "y": (k - 0.5 * (len(names) - 1)) * SPACING,
            "state_rate": 1.0 / COMMAND_PERIOD,
            "stepping": {"track_model": track_model},
        }
    return {name: {"ros__parameters": values} for name, values in nodes.items()}


if __name__ == "__main__":
    main()

"""Measure a run with ROS nodes: lockstep speed, late ticks in real time, latency, recording.

    python -m benchmarks.node_performance              # about 3 minutes
    python -m benchmarks.node_performance --runs 1     # faster, less precise

Lockstep: a dig cycle with nodes over DDS (soil, machine, operator, recorder), compared with the
same cycle in one process. Real time: the same cycle by the wall clock, and the fraction of ticks
that were late while the bucket held soil. Latency: from publishing a command to receiving the
message that reports it as applied. Everything is recorded; the CPU time of the recorder over wall
time and its lost messages are printed.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import interleave
from earthmoving_sim.demo_site import jacksboro_site
from earthmoving_sim.multi_process.dig import run_multi_process_dig
from earthmoving_sim.multi_process.node_process import NodeProcess, stop_all
from earthmoving_sim.multi_process.parameter_file import write_node_parameters
from earthmoving_sim.recorded_run.outcome import outcome_from_bag
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import (
    COMMAND_DELAY_TICKS,
    COMMAND_INTERVAL_TICKS,
    SingleProcessDig,
)
from msg_bridge.codec import qos
from msg_bridge.dds_profile import use_shipped_profile
from soil_sim.terrain import save_terrain

CONFIG = load_run_config("demo.yaml", {"cycles": 1})
MIN_LOADED_PARTICLES = 500
"""Number of particles above which the bucket counts as loaded."""
NUM_COMMANDS = 300
"""Number of commands whose latency is measured."""


class RealTimeResult(NamedTuple):
    """Result of a dig cycle in real time.

    Attributes:
        late_fraction: fraction of ticks that were late while the bucket was loaded.
        max_particles: maximum number of particles.
        recorder_cpu_fraction: CPU time of the recorder over wall time.
        num_lost: number of messages that the recorder lost.
    """

    late_fraction: float
    max_particles: float
    recorder_cpu_fraction: float
    num_lost: float


def main() -> None:
    """Measure and print."""
    parser = make_parser(__doc__, runs=3)
    parser.add_argument(
        "--commands", type=int, default=NUM_COMMANDS, help="commands whose latency is measured"
    )
    options = parser.parse_args()
    table = ResultTable([Column("median", "", ".2f")], as_json=options.json, row_width=44)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    table.print_header()
    factors = interleave([run_in_process, run_lockstep], options.runs)
    for name, values in zip(
        ("real-time factor, one process", "real-time factor, nodes in lockstep"),
        zip(*factors, strict=True),
        strict=True,
    ):
        table.print_row(name, [statistics.median(values)], remark=format_values(values))
    late, particles, recorder_cpu, lost = zip(
        *(run_in_real_time() for _ in range(options.runs)), strict=True
    )
    percent = [100.0 * fraction for fraction in late]
    table.print_row(
        "late ticks in real time [%]",
        [statistics.median(percent)],
        unit="%",
        remark=f"{format_values(percent)}; up to {max(particles):.0f} particles",
    )
    cpu = 100.0 * statistics.median(recorder_cpu)
    table.print_row("recorder, fraction of a core [%]", [cpu], unit="%")
    table.print_row("recorder, lost messages", [sum(lost)])
    latencies = measure_latency(options.commands)
    for percentile in (50, 99):
        latency = 1e3 * float(np.percentile(latencies, percentile))
        table.print_row(f"command latency, p{percentile} [ms]", [latency], unit="ms")


def format_values(values: Sequence[float]) -> str:
    """Return the values of all runs as a text, to show their scatter."""
    return "runs: " + ", ".join(f"{value:.2f}" for value in values)


def run_in_process() -> float:
    """Return simulated over wall time of a dig cycle in one process."""
    dig = SingleProcessDig(CONFIG, jacksboro_site())
    try:
        outcome = dig.run()
    finally:
        dig.close()
    return outcome.simulated_time / outcome.wall_time


def run_lockstep() -> float:
    """Return simulated over wall time of a dig cycle with ROS nodes in lockstep, recorded."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        run_multi_process_dig(CONFIG, jacksboro_site(), Path(folder), bag)
        outcome = outcome_from_bag(bag)
        return outcome.simulated_time / outcome.wall_time


def run_in_real_time() -> RealTimeResult:
    """Run a dig cycle with ROS nodes by the wall clock."""
    with (
        tempfile.TemporaryDirectory() as folder,
        RunningNodes(Path(folder), operator=True) as running,
    ):
        running.spin_until(lambda: running.processes["dig_operator"].exit_code is not None, 180.0)
        num_late = num_ticks = 0
        for before, after in zip(running.snapshots, running.snapshots[1:], strict=False):
            if min(before["particles"], after["particles"]) > MIN_LOADED_PARTICLES:
                num_late += int(after["late_ticks"] - before["late_ticks"])
                num_ticks += int(after["tick"] - before["tick"])
        return RealTimeResult(
            num_late / max(num_ticks, 1),
            max(each["particles"] for each in running.snapshots),
            running.recorder_cpu_fraction,
            running.snapshots[-1]["num_lost"],
        )


def measure_latency(count: int) -> list[float]:
    """Return wall times [s] from publishing a command to receiving it as applied."""
    latencies: list[float] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        RunningNodes(Path(folder), operator=False) as running,
    ):
        node, rng = running.node, np.random.default_rng(0)
        received: list[tuple[float, float]] = []

        def store(msg: JointState) -> None:
            received.append((time.monotonic(), msg.velocity[0]))

        node.create_subscription(JointState, "/excavator/applied_commands", store, qos.STATE)
        commands = node.create_publisher(JointState, "/excavator/joint_commands", qos.STATE)
        running.spin_until(lambda: len(received) > 100, 60.0)
        for number in range(count):
            time.sleep(float(rng.uniform(0.0, 0.02)))
            velocity = 1e-3 + 1e-6 * number  # a different value identifies each command
            sent = time.monotonic()
            commands.publish(JointState(name=["swing"], velocity=[velocity]))
            running.spin_until(lambda: bool(received) and received[-1][1] == velocity, 5.0)  # noqa: B023
            latencies.append(received[-1][0] - sent)
    return latencies


class RunningNodes:
    """Nodes that run in real time as subprocesses, and their diagnostics.

    Attributes:
        node: a node of this process.
        processes: processes by node name.
        snapshots: diagnostics values, one dictionary for each status of the soil node.
    """

    def __init__(self, folder: Path, *, operator: bool) -> None:
        """Start soil, machine, recorder, and optionally the operator; logs go to `folder`."""
        site, parameters = folder / "site.npz", folder / "parameters.yaml"
        save_terrain(site, jacksboro_site())
        write_node_parameters(
            parameters,
            CONFIG,
            site=site,
            bag=folder / "bag",
            realtime=True,
            command_interval_ticks=COMMAND_INTERVAL_TICKS,
            command_delay_ticks=COMMAND_DELAY_TICKS,
        )
        use_shipped_profile()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("node_performance")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._store, 10)
        self._latest: dict[str, float] = dict.fromkeys(
            ("particles", "late_ticks", "tick", "num_lost"), 0.0
        )
        self.snapshots: list[dict[str, float]] = []
        modules = {
            "exchange_recorder": "msg_bridge.recorder.recorder_node",
            "soil_sim": "soil_sim.node.soil_node",
            "machine_sim": "machine_sim.node.machine_node",
        }
        if operator:
            modules["dig_operator"] = "dig_operator.node"
        arguments = ["--ros-args", "--params-file", str(parameters)]
        self.processes = {
            name: NodeProcess(name, module, arguments, folder / f"{name}.log")
            for name, module in modules.items()
        }
        self._recorder_cpu: list[tuple[float, float]] = []  # wall time, CPU time [s]

    def __enter__(self) -> RunningNodes:
        return self

    def __exit__(self, *error: object) -> None:
        order = ("dig_operator", "exchange_recorder", "machine_sim", "soil_sim")
        stop_all([self.processes[name] for name in order if name in self.processes])
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def spin_until(self, condition: Callable[[], bool], timeout: float) -> None:
        """Process messages until a condition holds.

        Raises:
            TimeoutError: the condition does not hold after `timeout` [s].
        """
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"no result after {timeout:g} s; see the logs of the nodes")
            self._executor.spin_once(timeout_sec=0.05)

    @property
    def recorder_cpu_fraction(self) -> float:
        """CPU time of the recorder over wall time, without the first quarter of the run."""
        samples = self._recorder_cpu
        (wall_start, cpu_start), (wall_end, cpu_end) = samples[len(samples) // 4], samples[-1]
        return (cpu_end - cpu_start) / (wall_end - wall_start)

    def _store(self, msg: DiagnosticArray) -> None:
        """Keep the latest values; append a snapshot at each status of the soil node."""
        for status in msg.status:
            is_soil = "soil_sim" in status.name
            for value in status.values:
                if value.key in self._latest and (is_soil or value.key != "tick"):
                    self._latest[value.key] = float(value.value)
            if is_soil:
                self.snapshots.append(dict(self._latest))
                cpu_time = self.processes["exchange_recorder"].cpu_time
                self._recorder_cpu.append((time.monotonic(), cpu_time))


if __name__ == "__main__":
    main()

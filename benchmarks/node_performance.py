"""Measure a run with ROS nodes: lockstep speed, late ticks in real time, latency, recording.

    python benchmarks/node_performance.py              # everything, about 3 minutes
    python benchmarks/node_performance.py --runs 1     # quicker, less certain

Lockstep: a dig cycle with nodes over DDS (soil, machine, operator, recorder), compared with the
same
cycle in one process. Real time: the same cycle by the wall clock, with the ticks that were late
while
the bucket held soil. Latency: from publishing a command to receiving the tick in which it takes
effect. Everything is recorded; the CPU share of the recorder and its lost messages are printed.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

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
MIN_LOADED_PARTICLES = 500  # particles from which the bucket counts as working


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3, help="of each; medians are printed")
    runs = parser.parse_args().runs
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    direct, nodes = [], []
    for _ in range(runs):
        direct.append(in_process())
        nodes.append(lockstep())
    print(f"one process   {median(direct):5.2f} x real time")
    print(f"lockstep, DDS {median(nodes):5.2f} x real time, {format_values(nodes)}")
    late, most, recorder, missed = zip(*(real_time() for _ in range(runs)), strict=True)
    print(
        f"real time     {100 * median(late):5.2f} % of ticks late with up to {max(most):.0f}"
        f" particles, {format_values([100 * x for x in late])}"
    )
    print(f"recorder      {100 * median(recorder):5.1f} % of a core, {sum(missed):.0f} missed")
    waits = latency()
    for part in (50, 99):
        print(f"command       {1e3 * np.percentile(waits, part):5.1f} ms to its tick, p{part}")


def median(values: list[float] | tuple[float, ...]) -> float:
    """The middle one."""
    return statistics.median(values)


def format_values(values: list[float]) -> str:
    """All of them, so that one sees how they scatter."""
    return "of " + ", ".join(f"{value:.2f}" for value in values)


def in_process() -> float:
    """Simulated over wall time of a cycle in one process."""
    run = SingleProcessDig(CONFIG, jacksboro_site())
    try:
        outcome = run.run()
    finally:
        run.close()
    return outcome.simulated_time / outcome.wall_time


def lockstep() -> float:
    """The same with ROS nodes, recorded."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        run_multi_process_dig(CONFIG, jacksboro_site(), Path(folder), bag)
        outcome = outcome_from_bag(bag)
        return outcome.simulated_time / outcome.wall_time


def real_time() -> tuple[float, float, float, float]:
    """A cycle by the wall clock.

    Returns:
        (share of ticks that were late while particles were many, most particles, the recorder's
        share of a core, messages it missed).
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        RunningNodes(Path(folder), operator=True) as watched,
    ):
        watched.spin_until(lambda: watched.processes["dig_operator"].exit_code is not None, 180.0)
        late = ticks = 0
        for before, after in zip(watched.snapshots, watched.snapshots[1:], strict=False):
            if min(before["particles"], after["particles"]) > MIN_LOADED_PARTICLES:
                late += int(after["late_ticks"] - before["late_ticks"])
                ticks += int(after["tick"] - before["tick"])
        most = max(each["particles"] for each in watched.snapshots)
        return (
            late / max(ticks, 1),
            most,
            watched.recorder_cpu_fraction,
            watched.snapshots[-1]["num_lost"],
        )


def latency(count: int = 300) -> list[float]:
    """Wall times from publishing a command to hearing that it is applied [s]."""
    waits: list[float] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        RunningNodes(Path(folder), operator=False) as watched,
    ):
        node, rng = watched.node, np.random.default_rng(0)
        received: list[tuple[float, float]] = []

        def take(msg: JointState) -> None:
            received.append((time.monotonic(), msg.velocity[0]))

        node.create_subscription(JointState, "/excavator/applied_commands", take, qos.STATE)
        commands = node.create_publisher(JointState, "/excavator/joint_commands", qos.STATE)
        watched.spin_until(lambda: len(received) > 100, 60.0)
        for number in range(count):
            time.sleep(float(rng.uniform(0.0, 0.02)))
            wanted = 1e-3 + 1e-6 * number  # told apart by its value
            sent = time.monotonic()
            commands.publish(JointState(name=["swing"], velocity=[wanted]))
            watched.spin_until(lambda: bool(received) and received[-1][1] == wanted, 5.0)  # noqa: B023
            waits.append(received[-1][0] - sent)
    return waits


class RunningNodes:
    """Nodes in real time, and what they say of themselves."""

    def __init__(self, folder: Path, *, operator: bool) -> None:
        """Start them, with an operator or without."""
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
        self.node = Node("bench")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)
        self._now: dict[str, float] = dict.fromkeys(
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
        self._cpu: list[tuple[float, float]] = []

    def __enter__(self) -> RunningNodes:
        return self

    def __exit__(self, *error: object) -> None:
        order = ("dig_operator", "exchange_recorder", "machine_sim", "soil_sim")
        stop_all([self.processes[name] for name in order if name in self.processes])
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def spin_until(self, condition: Callable[[], bool], timeout: float) -> None:
        """Listen until a condition holds."""
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError("it does not come; look into what the nodes print")
            self._executor.spin_once(timeout_sec=0.05)

    @property
    def recorder_cpu_fraction(self) -> float:
        """CPU time of the recorder over wall time, start and end left out."""
        (t0, c0), (t1, c1) = self._cpu[len(self._cpu) // 4], self._cpu[-1]
        return (c1 - c0) / (t1 - t0)

    def _take(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            for value in status.values:
                if value.key in self._now and not status.name.startswith("bench"):
                    own_tick = "soil_sim" in status.name
                    if value.key != "tick" or own_tick:
                        self._now[value.key] = float(value.value)
            if "soil_sim" in status.name:
                self.snapshots.append(dict(self._now))
                self._cpu.append((time.monotonic(), self.processes["exchange_recorder"].cpu_time))


if __name__ == "__main__":
    main()

"""A run over DDS: soil, machine, operator and recorder as processes, until the shift is over.

The nodes do all the work. What is done here is what a launch file would do (start them with their
parameters, stop them in order) and to tell the user how it goes, from `/diagnostics`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from earthmoving_sim.demo_site import check_slope_stability
from earthmoving_sim.multi_process.node_process import NodeProcess, NodeProcessError, stop_all
from earthmoving_sim.multi_process.parameter_file import write_node_parameters
from earthmoving_sim.run_config import RunConfig
from earthmoving_sim.single_process_dig import COMMAND_DELAY_TICKS, COMMAND_INTERVAL_TICKS
from msg_bridge.dds_profile import use_shipped_profile
from soil_sim.terrain import HeightMap, save_terrain

__all__ = ["run_multi_process_dig"]

_PROGRESS_PERIOD = 1.0
"""Wall time between lines of progress [s]."""

_STARTUP_PROGRESS_PERIOD = 5.0
"""The same before the first tick [s]."""

_STALL_TIMEOUT = 60.0
"""Wall time without a new tick after which the run is given up [s]."""

_STARTUP_TIMEOUT = 300.0
"""The same before the first tick [s]: a first start compiles, on a busy machine slowly."""

_REQUIRED_NODES = ("soil_sim", "machine_sim", "dig_operator")
"""Those that must be up for a tick, as they name themselves."""


def run_multi_process_dig(
    config: RunConfig, site: HeightMap, folder: Path, bag: Path, *, realtime: bool = False
) -> None:
    """Run a shift with every part in a node of its own, and record it.

    Args:
        config: of the run.
        site: the terrain.
        folder: for the nodes' parameters and output.
        bag: folder to record into; must not exist.
        realtime: whether ticks follow the wall clock; else as fast as it goes, and repeatable.

    Raises:
        NodeProcessError: a node ended that should not have, or nothing went on for a minute.
        TerrainError: ground too steep to dig in.
    """
    check_slope_stability(site, config)
    folder.mkdir(parents=True, exist_ok=True)
    site_file, parameters = folder / "site.npz", folder / "parameters.yaml"
    save_terrain(site_file, site)
    write_node_parameters(
        parameters,
        config,
        site=site_file,
        bag=bag,
        realtime=realtime,
        command_interval_ticks=COMMAND_INTERVAL_TICKS,
        command_delay_ticks=COMMAND_DELAY_TICKS,
    )
    use_shipped_profile()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        monitor = _DiagnosticsMonitor(
            config.task.cycles, config.stepping.tick_period, realtime=realtime
        )
        try:
            _run(monitor, folder, parameters)
        finally:
            monitor.close()
    finally:
        rclpy.try_shutdown()


def _run(monitor: _DiagnosticsMonitor, folder: Path, parameters: Path) -> None:
    monitor.check_no_other_simulation()
    arguments = ["--ros-args", "--params-file", str(parameters)]
    started: dict[str, NodeProcess] = {}
    complaints: list[str] = []
    try:
        for name, module in (
            ("exchange_recorder", "msg_bridge.recorder.recorder_node"),
            ("soil_sim", "soil_sim.node.soil_node"),
            ("machine_sim", "machine_sim.node.machine_node"),
            ("dig_operator", "dig_operator.node"),
        ):
            started[name] = NodeProcess(name, module, arguments, folder / f"{name}.log")
        dig_operator = started["dig_operator"]
        others = [process for name, process in started.items() if name != "dig_operator"]
        while dig_operator.exit_code is None:
            monitor.spin()
            for process in others:
                process.check()
        if dig_operator.exit_code not in (0, 1):  # 1: it gave up, which the bag tells
            dig_operator.check()
        monitor.wait_for_final_hash()
    finally:
        # The recorder first: what comes now is only goodbyes. The machine needs the soil to leave.
        order = ("dig_operator", "exchange_recorder", "machine_sim", "soil_sim")
        complaints = stop_all([started[name] for name in order if name in started])
        monitor.end_line()
    if complaints:
        raise NodeProcessError("; ".join(complaints))


_STATE_HASH_TIMEOUT = 5.0
"""Longest wait for the last state hash [s, wall]; one comes every second or sooner."""


class _DiagnosticsMonitor:
    """Listens to `/diagnostics` and tells how it goes."""

    def __init__(self, cycles: int, tick: float, *, realtime: bool) -> None:
        self._cycles, self._tick, self._realtime = cycles, tick, realtime
        self._node = Node("demo")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._node.create_subscription(String, "/soil/state_hash", self._on_state_hash, 10)
        self._hashes: list[str] = []
        self._values: dict[str, Mapping[str, str]] = {}
        self._first_tick_time: float | None = None
        self._last_progress_time = time.monotonic()
        self._last_print_time = self._last_progress_time
        self._is_line_open = False

    def check_no_other_simulation(self) -> None:
        """Refuse to run beside another simulation: they would share their topics.

        Raises:
            NodeProcessError: there is a soil_sim already.
        """
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)
            if "soil_sim" in self._node.get_node_names():
                raise NodeProcessError(
                    "a soil_sim is running in this ROS domain already; stop it, or choose another"
                    " domain: export ROS_DOMAIN_ID=<1 to 101>"
                )

    def spin(self) -> None:
        """Listen for a moment.

        Raises:
            NodeProcessError: nothing has gone on for a long time.
        """
        self._executor.spin_once(timeout_sec=0.1)
        now = time.monotonic()
        patience = _STARTUP_TIMEOUT if self._first_tick_time is None else _STALL_TIMEOUT
        if now - self._last_progress_time > patience:
            raise NodeProcessError(
                f"there was no new tick for {patience:.0f} s; look into the nodes' output"
            )
        if now - self._last_print_time >= _PROGRESS_PERIOD:
            if self._value("soil_sim", "tick") > 0:
                self._last_print_time = now
                self._print_progress(now)
            elif now - self._last_print_time >= _STARTUP_PROGRESS_PERIOD:
                self._last_print_time = now
                self._print_startup_progress(now)

    def wait_for_final_hash(self) -> None:
        """Wait until the soil has told the hash of the state it is left in.

        It tells one twice where time stands still; in real time it goes on, and the second is new.
        """
        before = len(self._hashes)
        deadline = time.monotonic() + _STATE_HASH_TIMEOUT
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.1)
            new = self._hashes[before:]
            if len(new) >= 2 and (self._realtime or new[-1] == new[-2]):
                return

    def end_line(self) -> None:
        """Leave the line of progress."""
        if self._is_line_open:
            print()
            self._is_line_open = False

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        before = self._value("soil_sim", "tick")
        for status in msg.status:
            name = status.name.partition(":")[0].rpartition("/")[2]
            self._values[name] = {value.key: value.value for value in status.values}
        now = time.monotonic()
        if self._value("soil_sim", "tick") != before:
            self._last_progress_time = now
            self._first_tick_time = self._first_tick_time or now

    def _on_state_hash(self, msg: String) -> None:
        self._hashes.append(msg.data)

    def _value(self, node: str, key: str) -> float:
        return float(self._values.get(node, {}).get(key, 0.0))

    def _print_startup_progress(self, now: float) -> None:
        missing = ", ".join(name for name in _REQUIRED_NODES if name not in self._values)
        waiting = f"waiting for {missing}" if missing else "all nodes are up"
        line = (
            f"starting, {now - self._last_progress_time:.0f} s: {waiting} (a first start compiles, which takes"
            " up to a minute)"
        )
        self._write_line(line)

    def _print_progress(self, now: float) -> None:
        dig_operator = self._values.get("dig_operator", {})
        line = (
            f"cycle {dig_operator.get('cycle', '1')}/{self._cycles}"
            f"  {dig_operator.get('phase', ''):<8}"
            f" bucket {100 * self._value('machine_sim', 'payload_fill'):3.0f} %"
            f"  particles {self._value('machine_sim', 'particles'):5.0f}"
            f"  imbalance {self._value('soil_sim', 'imbalance_mm3'):.0f} mm3"
            f"  {self._value('soil_sim', 'tick') * self._tick:5.1f} s"
            f"  {self._value('soil_sim', 'real_time_factor'):4.1f} x real time"
            f"  bag {self._value('exchange_recorder', 'bytes') / 1e6:5.0f} MB"
        )
        self._write_line(line)

    def _write_line(self, line: str) -> None:
        if sys.stdout.isatty():
            print("\r" + line.ljust(118), end="", flush=True)
            self._is_line_open = True
        else:
            print(line, flush=True)

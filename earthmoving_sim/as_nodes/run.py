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

from earthmoving_sim.as_nodes.parameters import write_node_parameters
from earthmoving_sim.as_nodes.processes import NodeProcess, NodeProcessError, stop_all
from earthmoving_sim.dig_run import LOOK_EVERY, REACTION
from earthmoving_sim.run_config import RunConfig
from earthmoving_sim.site import refuse_landslide
from msg_bridge.dds import use_shipped_profile
from soil_sim.terrain import HeightMap, save_terrain

__all__ = ["run_nodes"]

_SAY_PERIOD = 1.0
"""Wall time between lines of progress [s]."""

_STARTING_SAY_PERIOD = 5.0
"""The same before the first tick [s]."""

_STALLED = 60.0
"""Wall time without a new tick after which the run is given up [s]."""

_STARTING = 300.0
"""The same before the first tick [s]: a first start compiles, on a busy machine slowly."""

_NODES = ("soil_sim", "machine_sim", "operator")
"""Those that must be up for a tick, as they name themselves."""


def run_nodes(
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
    refuse_landslide(site, config)
    folder.mkdir(parents=True, exist_ok=True)
    site_file, parameters = folder / "site.npz", folder / "parameters.yaml"
    save_terrain(site_file, site)
    write_node_parameters(
        parameters,
        config,
        site=site_file,
        bag=bag,
        realtime=realtime,
        look_every=LOOK_EVERY,
        reaction=REACTION,
    )
    use_shipped_profile()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        monitor = _Monitor(config.shift.cycles, config.stepping.tick, realtime=realtime)
        try:
            _run(monitor, folder, parameters)
        finally:
            monitor.close()
    finally:
        rclpy.try_shutdown()


def _run(monitor: _Monitor, folder: Path, parameters: Path) -> None:
    monitor.refuse_company()
    arguments = ["--ros-args", "--params-file", str(parameters)]
    started: dict[str, NodeProcess] = {}
    complaints: list[str] = []
    try:
        for name, module in (
            ("recorder", "msg_bridge.recorder.node"),
            ("soil_sim", "soil_sim.node"),
            ("machine_sim", "machine_sim.node"),
            ("operator", "machine_sim.operator.node"),
        ):
            started[name] = NodeProcess(name, module, arguments, folder / f"{name}.log")
        operator = started["operator"]
        others = [process for name, process in started.items() if name != "operator"]
        while operator.exit_code is None:
            monitor.spin()
            for process in others:
                process.check()
        if operator.exit_code not in (0, 1):  # 1: it gave up, which the bag tells
            operator.check()
        monitor.await_hash()
    finally:
        # The recorder first: what comes now is only goodbyes. The machine needs the soil to leave.
        order = ("operator", "recorder", "machine_sim", "soil_sim")
        complaints = stop_all([started[name] for name in order if name in started])
        monitor.end_line()
    if complaints:
        raise NodeProcessError("; ".join(complaints))


_LONGEST_HASH = 5.0
"""Longest wait for the last state hash [s, wall]; one comes every second or sooner."""


class _Monitor:
    """Listens to `/diagnostics` and tells how it goes."""

    def __init__(self, cycles: int, tick: float, *, realtime: bool) -> None:
        self._cycles, self._tick, self._realtime = cycles, tick, realtime
        self._node = Node("demo")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)
        self._node.create_subscription(String, "/soil/state_hash", self._take_hash, 10)
        self._hashes: list[str] = []
        self._values: dict[str, Mapping[str, str]] = {}
        self._began: float | None = None
        self._went_on = time.monotonic()
        self._said = self._went_on
        self._line_open = False

    def refuse_company(self) -> None:
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
        patience = _STARTING if self._began is None else _STALLED
        if now - self._went_on > patience:
            raise NodeProcessError(
                f"there was no new tick for {patience:.0f} s; look into the nodes' output"
            )
        if now - self._said >= _SAY_PERIOD:
            if self._number("soil_sim", "tick") > 0:
                self._said = now
                self._say(now)
            elif now - self._said >= _STARTING_SAY_PERIOD:
                self._said = now
                self._say_starting(now)

    def await_hash(self) -> None:
        """Wait until the soil has told the hash of the state it is left in.

        It tells one twice where time stands still; in real time it goes on, and the second is new.
        """
        before = len(self._hashes)
        deadline = time.monotonic() + _LONGEST_HASH
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.1)
            new = self._hashes[before:]
            if len(new) >= 2 and (self._realtime or new[-1] == new[-2]):
                return

    def end_line(self) -> None:
        """Leave the line of progress."""
        if self._line_open:
            print()
            self._line_open = False

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _take(self, msg: DiagnosticArray) -> None:
        before = self._number("soil_sim", "tick")
        for status in msg.status:
            name = status.name.partition(":")[0].rpartition("/")[2]
            self._values[name] = {value.key: value.value for value in status.values}
        now = time.monotonic()
        if self._number("soil_sim", "tick") != before:
            self._went_on = now
            self._began = self._began or now

    def _take_hash(self, msg: String) -> None:
        self._hashes.append(msg.data)

    def _number(self, node: str, key: str) -> float:
        return float(self._values.get(node, {}).get(key, 0.0))

    def _say_starting(self, now: float) -> None:
        missing = ", ".join(name for name in _NODES if name not in self._values)
        waiting = f"waiting for {missing}" if missing else "all nodes are up"
        line = (
            f"starting, {now - self._went_on:.0f} s: {waiting} (a first start compiles, which takes"
            " up to a minute)"
        )
        self._write(line)

    def _say(self, now: float) -> None:
        operator = self._values.get("operator", {})
        line = (
            f"cycle {operator.get('cycle', '1')}/{self._cycles}"
            f"  {operator.get('phase', ''):<8}"
            f" bucket {100 * self._number('machine_sim', 'payload_fill'):3.0f} %"
            f"  particles {self._number('machine_sim', 'particles'):5.0f}"
            f"  imbalance {self._number('soil_sim', 'imbalance_mm3'):.0f} mm3"
            f"  {self._number('soil_sim', 'tick') * self._tick:5.1f} s"
            f"  {self._number('soil_sim', 'real_time_factor'):4.1f} x real time"
            f"  bag {self._number('recorder', 'bytes') / 1e6:5.0f} MB"
        )
        self._write(line)

    def _write(self, line: str) -> None:
        if sys.stdout.isatty():
            print("\r" + line.ljust(118), end="", flush=True)
            self._line_open = True
        else:
            print(line, flush=True)

"""RunMonitor: reports the progress of a run with nodes, from `/diagnostics`, and detects stalls."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String

from earthmoving_sim.multi_process.node_process import (
    NodeProcess,
    NodeProcessError,
    describe_logs,
    waiting_reasons,
)
from msg_bridge.nodes.wait_log import NOTHING

__all__ = ["RunMonitor", "startup_line"]

_PROGRESS_PERIOD = 1.0
"""Wall time between lines of progress [s]."""

_STARTUP_PROGRESS_PERIOD = 5.0
"""Wall time between lines of progress before the first tick [s]."""

_STALL_TIMEOUT = 60.0
"""Wall time without a new tick after which the run is aborted [s]."""

_STARTUP_TIMEOUT = 600.0
"""Wall time without a first tick after which the run is aborted [s]; a first start compiles."""

_DISCOVERY_TIME = 1.0
"""Wall time in which another simulation in the domain is looked for [s]."""

_STATE_HASH_TIMEOUT = 5.0
"""Maximum wait for the last state hash [s]; one is published at least every second."""

_REQUIRED_NODES = ("soil_sim", "machine_sim", "dig_operator")
"""Nodes that must publish diagnostics before the first tick."""

_HAUL_OPERATOR = "haul_operator"
"""Name of the process and of the diagnostics of a truck's operator."""

_DIGGER_PREFIX = "digger/"
"""Prefix of the diagnostics of the excavator in a node with a truck."""

_LINE_WIDTH = 118
"""Width to which a line of progress is padded, so that it replaces the previous one."""


class RunMonitor:
    """Subscribes to diagnostics and state hashes, and prints the progress of a run."""

    def __init__(self, cycles: int, tick_period: float, *, realtime: bool, truck: str = "") -> None:
        """
        Args:
            cycles: number of cycles of the operator's task, or of loads of the truck's.
            tick_period: duration of a tick [s].
            realtime: whether ticks follow the wall clock.
            truck: namespace of the truck that the excavator loads; empty without one.
        """
        self._truck = truck
        self._cycles, self._tick_period, self._realtime = cycles, tick_period, realtime
        self._node = Node("demo")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._node.create_subscription(String, "/soil/state_hash", self._on_state_hash, 10)
        self._hashes: list[str] = []
        self._values: dict[str, Mapping[str, str]] = {}  # by node
        self._has_ticked = False
        self._last_progress_time = time.monotonic()
        self._last_print_time = self._last_progress_time
        self._is_line_open = False

    @property
    def has_ticked(self) -> bool:
        """Whether the soil has done a tick."""
        return self._has_ticked

    def check_no_other_simulation(self) -> None:
        """Check that no soil node runs in the same namespace: its topics would be the same.

        Raises:
            NodeProcessError: there is one.
        """
        deadline = time.monotonic() + _DISCOVERY_TIME
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)
            nodes = self._node.get_node_names_and_namespaces()
            if ("soil_sim", self._node.get_namespace()) in nodes:
                raise NodeProcessError(
                    "a soil_sim is running in this ROS domain and namespace already; stop it, or"
                    " choose another domain: export ROS_DOMAIN_ID=<1 to 101>"
                )

    def spin(self, processes: Sequence[NodeProcess]) -> None:
        """Process messages for a moment and print the progress when it is due.

        Args:
            processes: the nodes, whose output is searched for the reason of a stall.

        Raises:
            NodeProcessError: there was no new tick for too long; the message has the reason, as
                far as the nodes print it, and the end of their output.
        """
        self._executor.spin_once(timeout_sec=0.1)
        now = time.monotonic()
        elapsed = now - self._last_progress_time
        if elapsed > (_STALL_TIMEOUT if self._has_ticked else _STARTUP_TIMEOUT):
            raise NodeProcessError(self._describe_stall(elapsed, processes))
        period = _PROGRESS_PERIOD if self._has_ticked else _STARTUP_PROGRESS_PERIOD
        if now - self._last_print_time >= period:
            self._last_print_time = now
            if self._has_ticked:
                self._print_progress()
            else:
                self._print_startup_progress(elapsed, processes)

    def wait_for_final_hash(self) -> None:
        """Wait until the soil has published the hash of its final state.

        In lockstep time stands still now, so two equal hashes in a row are final. In real time it
        continues, and the second hash from now is that of a later state.
        """
        num_hashes = len(self._hashes)
        deadline = time.monotonic() + _STATE_HASH_TIMEOUT
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.1)
            new = self._hashes[num_hashes:]
            if len(new) >= 2 and (self._realtime or new[-1] == new[-2]):
                return

    def end_line(self) -> None:
        """End the line of progress."""
        if self._is_line_open:
            print()
            self._is_line_open = False

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        previous_tick = self._value("soil_sim", "tick")
        for status in msg.status:
            full_name = status.name.partition(":")[0]
            name = full_name.rpartition("/")[2]
            if self._truck and full_name.strip("/").startswith(f"{self._truck.strip('/')}/"):
                name = _HAUL_OPERATOR
            self._values[name] = {value.key: value.value for value in status.values}
        tick = self._value("soil_sim", "tick")
        if tick != previous_tick:
            self._last_progress_time = time.monotonic()
            self._has_ticked = tick > 0

    def _on_state_hash(self, msg: String) -> None:
        self._hashes.append(msg.data)

    def _value(self, node: str, key: str) -> float:
        return float(self._values.get(node, {}).get(key, 0.0))

    def _describe_wait(self, processes: Sequence[NodeProcess]) -> str:
        """Return what the run waits for, as far as it is known.

        The CPU time of a node that has not published yet shows whether it is compiling.
        """
        missing = [
            f"{process.name} ({process.cpu_time:.0f} s of CPU time so far)"
            for process in processes
            if process.name in _REQUIRED_NODES and process.name not in self._values
        ]
        reasons = [f"waiting for the first diagnostics of {', '.join(missing)}"] if missing else []
        return "; ".join([*reasons, *waiting_reasons(processes)]) or "all nodes are running"

    def _describe_stall(self, elapsed: float, processes: Sequence[NodeProcess]) -> str:
        return (
            f"there was no new tick for {elapsed:.0f} s: {self._describe_wait(processes)}."
            f" The nodes' last output:\n{describe_logs(processes)}"
        )

    def _print_startup_progress(self, elapsed: float, processes: Sequence[NodeProcess]) -> None:
        self._write_line(startup_line(elapsed, self._describe_wait(processes)))

    def _print_progress(self) -> None:
        operator = self._values.get("dig_operator", {})
        total, truck, fill = f"/{self._cycles}", "", "payload_fill"
        if self._truck:
            hauler = self._values.get(_HAUL_OPERATOR, {})
            truck = f" truck {hauler.get('cycle', '1')}{total} {hauler.get('phase', ''):<8}"
            total, fill = "", f"{_DIGGER_PREFIX}payload_fill"
        self._write_line(
            f"cycle {operator.get('cycle', '1')}{total}"
            f"  {operator.get('phase', ''):<8}{truck}"
            f" bucket {100 * self._value('machine_sim', fill):3.0f} %"
            f"  particles {self._value('machine_sim', 'particles'):5.0f}"
            f"  imbalance {self._value('soil_sim', 'imbalance_mm3'):.0f} mm3"
            f"  {self._value('soil_sim', 'tick') * self._tick_period:5.1f} s"
            f"  {self._value('soil_sim', 'real_time_factor'):4.1f} x real time"
            f"  bag {self._value('exchange_recorder', 'bytes_on_disk') / 1e6:5.0f} MB"
            f"{self._describe_operator_waits()}"
        )

    def _describe_operator_waits(self) -> str:
        """Return what the operators wait for; empty if neither waits."""
        operators = {"excavator": "dig_operator", "truck": _HAUL_OPERATOR}
        waits = {
            name: self._values.get(node, {}).get("waiting_for", NOTHING)
            for name, node in operators.items()
        }
        return "".join(
            f"  {name} waits for {what}" for name, what in waits.items() if what != NOTHING
        )

    def _write_line(self, line: str) -> None:
        if sys.stdout.isatty():
            print("\r" + line.ljust(_LINE_WIDTH), end="", flush=True)
            self._is_line_open = True
        else:
            print(line, flush=True)


def startup_line(elapsed: float, reason: str) -> str:
    """Return the line of progress before the first tick.

    Args:
        elapsed: wall time since the start [s].
        reason: what the run waits for.
    """
    hint = "; this is done once and takes 1 to 4 minutes" if "compiling" in reason else ""
    return f"starting, {elapsed:.0f} s: {reason}{hint}"

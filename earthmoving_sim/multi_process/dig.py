"""A run with nodes: soil, machine, operator and recorder as processes, until the task has ended.

The nodes do all the work. This module does what a launch file would do: it starts them with their
parameters and stops them in order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.signals import SignalHandlerOptions

from earthmoving_sim.demo_site import check_slope_stability
from earthmoving_sim.multi_process.node_process import (
    STARTUP_STOP_TIMEOUT,
    STOP_TIMEOUT,
    NodeProcess,
    NodeProcessError,
    stop_all,
)
from earthmoving_sim.multi_process.parameter_file import (
    DIGGER_NAMESPACE,
    EXCAVATOR_NAMESPACE,
    SITE_NAMESPACE,
    write_node_parameters,
)
from earthmoving_sim.multi_process.run_monitor import RunMonitor
from earthmoving_sim.run_config import RunConfig
from earthmoving_sim.single_process_dig import COMMAND_DELAY_TICKS, COMMAND_INTERVAL_TICKS
from msg_bridge.dds_profile import keep_discovery_on_this_host, use_shipped_profile
from soil_sim.terrain import HeightMap, save_terrain

__all__ = ["ObserverNode", "run_multi_process_dig"]

_OPERATOR_MODULE = "dig_operator.node"

_STOP_ORDER = ("haul_operator", "dig_operator", "exchange_recorder", "machine_sim", "soil_sim")
"""The recorder stops early: only farewells follow. The machine needs the soil to leave."""

_OPERATOR_EXIT_CODES = (0, 1)
"""Exit codes of an operator that completed (0) or aborted (1) its task; the bag has the phase."""


class _SimulationNode(NamedTuple):
    """A node of the run.

    Attributes:
        name: name of its process and log.
        module: its module.
        namespace: its namespace.
    """

    name: str
    module: str
    namespace: str = "/"

    def start(self, folder: Path, parameters: Path) -> NodeProcess:
        """Start its process, with a log in the folder.

        Args:
            folder: folder for the log.
            parameters: parameter file of all nodes.
        """
        namespace = ["-r", f"__ns:={self.namespace}"]
        arguments = ["--ros-args", "--params-file", str(parameters), *namespace]
        return NodeProcess(self.name, self.module, arguments, folder / f"{self.name}.log")


class ObserverNode(NamedTuple):
    """A node that only shows the run.

    Attributes:
        name: name of its process and log.
        module: its module.
        parameters: its parameters by name, each as text.
    """

    name: str
    module: str
    parameters: Mapping[str, str]

    def start(self, folder: Path) -> NodeProcess:
        """Start its process, with a log in the folder."""
        arguments = ["--ros-args"]
        for name, value in self.parameters.items():
            arguments += ["-p", f"{name}:={value}"]
        return NodeProcess(self.name, self.module, arguments, folder / f"{self.name}.log")


def run_multi_process_dig(
    config: RunConfig,
    site: HeightMap,
    folder: Path,
    bag: Path,
    *,
    realtime: bool = False,
    observers: Sequence[ObserverNode] = (),
) -> None:
    """Run the operator's task with every part in a node of its own, and record it.

    Args:
        config: parameters of the run.
        site: the terrain.
        folder: folder for the nodes' parameters and output.
        bag: folder to record into; must not exist.
        realtime: whether ticks follow the wall clock; else as fast as possible, and repeatable.
        observers: nodes that show the run; they are started first and stopped first.

    Raises:
        NodeProcessError: a node ended unexpectedly, or the run made no progress.
        TerrainError: the ground is too steep, or the machine would stand off the map.
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
    keep_discovery_on_this_host()
    use_shipped_profile()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        monitor = RunMonitor(
            config.haul.loads if config.task.truck else config.task.cycles,
            config.stepping.tick_period,
            realtime=realtime,
            truck=config.task.truck,
        )
        try:
            _run_nodes(monitor, _nodes(config), folder, parameters, observers)
        finally:
            monitor.close()
    finally:
        rclpy.try_shutdown()


def _nodes(config: RunConfig) -> list[_SimulationNode]:
    """Return the nodes of a run in the order of their start, the operators last."""
    has_truck = config.truck_machine is not None
    machines = SITE_NAMESPACE if has_truck else EXCAVATOR_NAMESPACE
    digger = DIGGER_NAMESPACE if has_truck else EXCAVATOR_NAMESPACE
    nodes = [
        _SimulationNode("exchange_recorder", "msg_bridge.recorder.recorder_node"),
        _SimulationNode("soil_sim", "soil_sim.node.soil_node"),
        _SimulationNode("machine_sim", "machine_sim.node.machine_node", machines),
        _SimulationNode("dig_operator", _OPERATOR_MODULE, digger),
    ]
    if has_truck:
        nodes.append(_SimulationNode("haul_operator", _OPERATOR_MODULE, config.task.truck))
    return nodes


def _run_nodes(
    monitor: RunMonitor,
    nodes: Sequence[_SimulationNode],
    folder: Path,
    parameters: Path,
    observers: Sequence[ObserverNode],
) -> None:
    """Start the nodes, wait until an operator has ended, and stop the others.

    The operator of an excavator with a truck ends only if its task is aborted.
    """
    monitor.check_no_other_simulation()
    started: dict[str, NodeProcess] = {}
    problems: list[str] = []
    try:
        for each in observers:
            started[each.name] = each.start(folder)
        for node in nodes:
            started[node.name] = node.start(folder, parameters)
        operators = [started[node.name] for node in nodes if node.module == _OPERATOR_MODULE]
        others = [process for process in started.values() if process not in operators]
        while all(operator.exit_code is None for operator in operators):
            monitor.spin(list(started.values()))
            for process in others:
                process.check()
        for operator in operators:
            if operator.exit_code not in (None, *_OPERATOR_EXIT_CODES):
                operator.check()
        monitor.wait_for_final_hash()
    finally:
        timeout = STOP_TIMEOUT if monitor.has_ticked else STARTUP_STOP_TIMEOUT
        order = [*(each.name for each in observers), *_STOP_ORDER]
        problems = stop_all([started[name] for name in order if name in started], timeout)
        monitor.end_line()
    if problems:
        raise NodeProcessError("; ".join(problems))

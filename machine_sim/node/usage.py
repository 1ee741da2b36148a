"""Contents of `machine_sim --help`."""

from __future__ import annotations

from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams
from machine_sim.node.params import BinParams, MachineInstanceParams, MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.sensors import SensorParams
from msg_bridge.nodes.node_usage import NodeUsage
from msg_bridge.recovery.params import RecoveryParams

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Simulate one or several machines, their tools and the excavated soil as particles. The node's"
    " namespace <n> (-r __ns:=/excavator) is also that of its only machine <m>; of several machines"
    " each has a namespace <n>/<machine>.",
    parameters={
        "": MachineNodeParams,
        "<machine>.": MachineInstanceParams,
        "<bin>.": BinParams,
        "stepping.": MachineSimParams,
        "particles.": ParticleParams,
        "sensors.": SensorParams,
        "commands.": CommandParams,
        "recovery.": RecoveryParams,
    },
)

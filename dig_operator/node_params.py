"""Parameters of the operator node."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["DigOperatorNodeParams"]


@dataclass(frozen=True)
class DigOperatorNodeParams(Parameters):
    """The machine to operate."""

    machine: str = parameter(
        "machines/excavator.yaml", "machine file, the same as that of the machine node"
    )
    other_machines: tuple[str, ...] = parameter(
        (), "namespaces of other machines on the site, which it keeps clear of", items=str
    )
    keep_running: bool = parameter(
        False, "whether to hold the machine still after the task, instead of ending"
    )
    simulation_namespace: str = parameter(
        "", "namespace of the soil node; empty: one level above the operator's own"
    )

"""Which machines there are, by the names of topics, live or in a bag."""

from __future__ import annotations

from collections.abc import Collection

from msg_bridge.contract import topics
from msg_bridge.contract.topics import parent_namespace, resolve

__all__ = ["machine_namespaces", "machine_node_of"]


def machine_namespaces(
    names: Collection[str], simulation: str = "/", marker: str = topics.ROBOT_DESCRIPTION
) -> list[str]:
    """Return the namespaces of the machines of a simulation, sorted.

    Args:
        names: absolute names of all topics.
        simulation: namespace of the soil node.
        marker: topic that every machine has.
    """
    suffix = f"/{marker}"
    own = simulation.rstrip("/")
    found = (name.removesuffix(suffix) for name in names if name.endswith(suffix))
    nested = [
        each
        for name in names
        if name.endswith(f"/{topics.SOIL_TICK}")
        and (each := name.removesuffix(f"/{topics.SOIL_TICK}")) != own
        and each.startswith(f"{own}/")
    ]
    return sorted(
        namespace
        for namespace in found
        if namespace.startswith(f"{own}/")
        and not any(namespace.startswith(f"{each}/") for each in nested)
    )


def machine_node_of(machine: str, names: Collection[str]) -> str:
    """Return the namespace of the node of a machine: that of the machine, or its parent.

    Args:
        machine: namespace of the machine.
        names: absolute names of all topics.
    """
    parent = parent_namespace(machine)
    if resolve(topics.MACHINE_CONFIG, machine) not in names and (
        resolve(topics.MACHINE_CONFIG, parent) in names
    ):
        return parent
    return machine

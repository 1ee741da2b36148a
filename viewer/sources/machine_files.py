"""The machine file that the configuration of a machine node names."""

from __future__ import annotations

import re

import yaml

from machine_sim.machine import MachineSpec, load_machine_spec
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.yaml_text import load_yaml

__all__ = ["spec_in_config"]

_SHIPPED = re.compile(r"machines/[A-Za-z0-9_-]+\.yaml")
"""Names of machine files that are read: shipped ones, not any path that a message names."""


def spec_in_config(config: str, machine: str) -> MachineSpec | None:
    """Return the specification of a machine; None if its file is not one of the shipped ones.

    Args:
        config: configuration of its machine node, YAML.
        machine: namespace of the machine.
    """
    try:
        content = load_yaml(config)
        own = (content.get("machines") or {}).get(machine.rpartition("/")[2]) or {}
        name = str(own.get("machine") or content["machine_sim"]["machine"])
        return load_machine_spec(find_config(name)) if _SHIPPED.fullmatch(name) else None
    except (yaml.YAMLError, AttributeError, KeyError, TypeError, EarthmovingError):
        return None

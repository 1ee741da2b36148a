"""Shipped parameter files name exactly the values that differ from the defaults."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import dig_operator.usage
import machine_sim.node.usage
import msg_bridge.recorder.usage
import soil_sim.node.usage
import viewer.cameras.usage
import viewer.usage
from earthmoving_sim.config_layers import SECTIONS
from msg_bridge.contract.parameters import Parameters

CONFIG = Path(__file__).resolve().parents[2] / "config"
FILES = sorted(path.name for path in CONFIG.glob("*.yaml") if path.name != "soils.yaml")

GROUPS = {
    "soil_sim": soil_sim.node.usage.USAGE.parameters,
    "machine_sim": machine_sim.node.usage.USAGE.parameters,
    "exchange_recorder": msg_bridge.recorder.usage.USAGE.parameters,
    "viewer": viewer.usage.USAGE.parameters,
    "camera": viewer.cameras.usage.USAGE.parameters,
    "dig_operator": dig_operator.usage.USAGE.parameters,
}
DEMO_GROUPS = {f"{section}.": kind for section, kind in SECTIONS.items()}


def changed_names(values: dict[str, Any], groups: dict[str, type[Parameters]]) -> Iterator[str]:
    """Yield the full name of each parameter whose value is not its default.

    Sections that are no parameter group are machines. Building the dataclasses validates names,
    types and ranges.
    """
    sections = {name: each for name, each in values.items() if isinstance(each, dict)}
    top_level = {name: each for name, each in values.items() if name not in sections}
    if "" not in groups:  # the demo's file, which has only sections and the machine
        assert set(top_level) <= {"machine"}
        top_level = {}
    for section, section_values in {"": top_level, **sections}.items():
        prefix = f"{section}." if section else ""
        if not (section or section_values):
            continue
        kind = groups[prefix if prefix in groups else "<machine>."]
        params, defaults = kind.from_mapping(section_values), kind()
        for name in section_values:
            if getattr(params, name) != getattr(defaults, name):
                yield prefix + name


def documented_names(text: str) -> list[str]:
    """Return the names after "Not the defaults:" in the comment at the start of a file."""
    lines = re.match(r"(#.*\n)+", text)
    assert lines is not None, "a shipped file starts with a comment"
    comment = " ".join(line.lstrip("# ") for line in lines[0].splitlines())
    if "All values are the defaults." in comment:
        return []
    listed = re.search(r"Not the defaults: (.*?)\.(?: |$)", comment)
    assert listed is not None, "the comment lists the values that are not the defaults"
    return [name.strip() for name in listed[1].split(",")]


@pytest.mark.parametrize("name", FILES)
def test_comment_lists_the_values_that_differ_from_the_defaults(name: str) -> None:
    text = (CONFIG / name).read_text(encoding="utf-8")
    content = yaml.safe_load(text)
    nodes = [(key.split("/")[-1], each) for key, each in content.items()]
    if {node for node, _ in nodes} <= set(GROUPS):
        names = (
            parameter
            for node, each in nodes
            for parameter in changed_names(each["ros__parameters"], dict(GROUPS[node]))
        )
        changed = list(dict.fromkeys(names))  # of several nodes of a kind each name once
    else:
        changed = list(changed_names(content, DEMO_GROUPS))
    assert documented_names(text) == changed

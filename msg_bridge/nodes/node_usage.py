"""Help text of a node executable, from its parameter dataclasses and the interface table.

Needs no running ROS context.
"""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msg_bridge.contract.interface import Endpoint, endpoints_of
from msg_bridge.contract.parameters import Parameters, item_type, node_fields

__all__ = ["NodeUsage"]

_WIDTH = 100
"""Maximum length of a line."""


@dataclass(frozen=True)
class NodeUsage:
    """Purpose and parameters of a node executable.

    Names of topics are printed as in a simulation in the root namespace; `<n>` is the namespace of
    a machine node and `<m>` that of a machine.

    Attributes:
        summary: what the node does, one sentence or two.
        parameters: dataclass of each parameter group by its prefix, with its dot; "" without one.
    """

    summary: str
    parameters: Mapping[str, type[Parameters]]

    def text(self, name: str) -> str:
        """Return the help text of the executable of a name."""
        sections = [
            f"usage: {name} [-h] [--ros-args [-p NAME:=VALUE]... [--params-file FILE]"
            " [-r FROM:=TO]...]",
            textwrap.fill(self.summary, _WIDTH),
            *_endpoint_sections(name),
            "Parameters:\n"
            + "\n".join(
                _parameter_text(prefix, each)
                for prefix, params_class in self.parameters.items()
                for each in node_fields(params_class)
            ),
        ]
        return "\n\n".join(sections)


def _endpoint_sections(executable: str) -> list[str]:
    """Return the sections on the topics and services of an executable."""
    titles = ("Subscribed topics", "Published topics", "Services")
    return [
        f"{title}:\n" + "\n".join(_entry(each.full_name, _meaning(each)) for each in endpoints)
        for title, endpoints in zip(titles, endpoints_of(executable), strict=True)
        if endpoints
    ]


def _meaning(endpoint: Endpoint) -> str:
    condition = f" (only if {endpoint.condition})" if endpoint.condition else ""
    return f"{endpoint.type}: {endpoint.description}{condition}"


def _entry(heading: str, text: str) -> str:
    indent = " " * 6
    return f"  {heading}\n" + textwrap.fill(
        text, _WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
    )


def _parameter_text(prefix: str, parameter: dataclasses.Field[Any]) -> str:
    """Return name, type, unit, range, default and meaning of a parameter."""
    meta, items = parameter.metadata, item_type(parameter)
    facts = [f"list of {items.__name__}" if items else type(parameter.default).__name__]
    if meta["unit"]:
        facts[0] += f" [{meta['unit']}]"
    if meta["choices"]:
        facts.append(f"one of {', '.join(meta['choices'])}")
    if not (math.isinf(meta["low"]) and math.isinf(meta["high"])):
        facts.append(f"{meta['low']:g} to {meta['high']:g}")
    facts.append(f"default {_default_text(parameter.default)}")
    return _entry(f"{prefix}{parameter.name}: {', '.join(facts)}", meta["doc"])


def _default_text(value: Any) -> str:
    """Return a default as YAML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"[{', '.join(_default_text(item) for item in value)}]"
    return str(value) or '""'

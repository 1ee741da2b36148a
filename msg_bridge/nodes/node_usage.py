"""Help text of a node executable, from its parameter dataclasses; needs no running ROS context."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from msg_bridge.contract.parameters import Parameters, item_type

__all__ = ["NodeUsage"]

_WIDTH = 100
"""Maximum length of a line."""


@dataclass(frozen=True)
class NodeUsage:
    """Purpose, parameters and topics of a node executable.

    Attributes:
        summary: what the node does, one sentence or two.
        parameters: dataclass of each parameter group by its prefix, with its dot; "" without one.
        subscriptions, publications, services: meaning by topic or service name.
    """

    summary: str
    parameters: Mapping[str, type[Parameters]]
    subscriptions: Mapping[str, str] = field(default_factory=dict)
    publications: Mapping[str, str] = field(default_factory=dict)
    services: Mapping[str, str] = field(default_factory=dict)

    def text(self, name: str) -> str:
        """Return the help text of the executable of a name."""
        sections = [
            f"usage: {name} [-h] [--ros-args [-p NAME:=VALUE]... [--params-file FILE]"
            " [-r FROM:=TO]...]",
            textwrap.fill(self.summary, _WIDTH),
            *self._name_sections(),
            "Parameters:\n"
            + "\n".join(
                _parameter_text(prefix, each)
                for prefix, params_class in self.parameters.items()
                for each in fields(params_class)
            ),
        ]
        return "\n\n".join(sections)

    def _name_sections(self) -> list[str]:
        """Return the sections on topics and services that the node has."""
        titles = {
            "Subscribed topics": self.subscriptions,
            "Published topics": self.publications,
            "Services": self.services,
        }
        return [
            f"{title}:\n" + "\n".join(_entry(name, text) for name, text in meanings.items())
            for title, meanings in titles.items()
            if meanings
        ]


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

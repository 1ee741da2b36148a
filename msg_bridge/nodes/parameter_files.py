"""Find files given by `--params-file` of which no section is for the node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node

from msg_bridge.nodes.ros_parameters import parameter_overrides
from msg_bridge.yaml_text import load_yaml

__all__ = ["describe_unused_files"]

_PARAMETERS = "ros__parameters"


def describe_unused_files(node: Node, args: Sequence[str]) -> list[str]:
    """Return a sentence for each parameter file that gives the node no parameter.

    ROS ignores sections of other nodes without a message, so that a node whose name or namespace
    differs from that in the file runs with its defaults.

    Args:
        node: the node.
        args: command line of its process.
    """
    sentences = []
    given = set(parameter_overrides(node))
    for option, file in pairwise(args):
        if option != "--params-file":
            continue
        try:
            content = load_yaml(Path(file).read_text())
        except (OSError, UnicodeDecodeError, yaml.YAMLError):  # ROS has read it, in its own way
            continue
        sections = dict(_find_sections("", content))
        if sections and not any(given & names for names in sections.values()):
            own = node.get_fully_qualified_name()
            sentences.append(
                f"no parameter in {file} is for this node, {own}: it has those of"
                f" {', '.join(sections)}; name the section {own}, or /** for all nodes"
            )
    return sentences


def _find_sections(name: str, content: Any) -> Iterator[tuple[str, set[str]]]:
    """Yield the name of each section of a file, and the names of its parameters.

    Args:
        name: name of the node, or of the namespace, to which the content belongs.
        content: a part of the file.
    """
    for key, value in content.items() if isinstance(content, Mapping) else ():
        if key == _PARAMETERS:
            yield name, set(_find_names("", value))
        else:
            yield from _find_sections(f"{name}/{str(key).strip('/')}", value)


def _find_names(prefix: str, content: Any) -> Iterator[str]:
    """Yield the names of all parameters in a section, with dots between their parts."""
    for key, value in content.items() if isinstance(content, Mapping) else ():
        if isinstance(value, Mapping):
            yield from _find_names(f"{prefix}{key}.", value)
        else:
            yield f"{prefix}{key}"

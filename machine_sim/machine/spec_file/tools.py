"""Reads the tools of a machine file."""

from __future__ import annotations

from collections.abc import Mapping

from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import Joint
from machine_sim.machine.spec_file.section import Section
from machine_sim.machine.tools.shapes import TOOL_SHAPES, ToolMount

__all__ = ["read_tools"]


def read_tools(section: Section, joints: Mapping[str, Joint]) -> dict[str, ToolMount]:
    """Read `tools`: by name, each with its link and its shape.

    Args:
        section: section `tools` of the file.
        joints: joints of the machine; a tool is fixed to a link that one of them moves.

    Raises:
        MachineError: an unknown kind or link, a drum on a joint that does not turn about y, or
            numbers out of range.
    """
    axes = {joint.child: joint.axis for joint in joints.values()}
    tools = {}
    for name in section.names():
        tool = section.section(name)
        link, kind = tool.text("link"), tool.text("kind")
        if link not in axes:
            moved = ", ".join(axes) or "none yet, so add a link with its joint"
            raise MachineError(
                f"tools.{name}.link is {link!r}; give a link that a joint moves: {moved}"
            )
        if kind not in TOOL_SHAPES:
            raise MachineError(
                f"tools.{name}.kind is {kind!r}; give one of {', '.join(TOOL_SHAPES)}"
            )
        shape = TOOL_SHAPES[kind]
        if shape.spins and axes[link] != "y":
            raise MachineError(
                f"tools.{name} is a {kind} on link {link}, whose joint rotates about"
                f" {axes[link]}; a {kind} rotates about y: give a link with such a joint"
            )
        tools[name] = ToolMount(link, shape.from_section(tool))
        tool.reject_unknown_keys()
    return tools

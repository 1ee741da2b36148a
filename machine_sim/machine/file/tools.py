"""The tools in a machine file."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from machine_sim.machine.description import Joint
from machine_sim.machine.errors import MachineError
from machine_sim.machine.file.section import Section
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.bucket import KEY_PAIRS, BucketShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.machine.tools.shapes import ToolMount, ToolShape

__all__ = ["read_tools"]


def read_tools(section: Section, joints: Mapping[str, Joint]) -> dict[str, ToolMount]:
    """Read `tools`: by name, each with the link that it is fixed to and its shape.

    Args:
        section: of the file.
        joints: of the machine; a tool is fixed to a link that one of them moves.

    Raises:
        MachineError: a shape or a link there is none of, a drum that does not spin about its axis,
            or numbers out of range.
    """
    axes = {joint.child: joint.axis for joint in joints.values()}
    tools = {}
    for name in section.names():
        tool = section.section(name)
        link, shape = tool.text("link"), tool.text("shape")
        if link not in axes:
            moved = ", ".join(axes) or "there is none, so add one with its joint"
            raise MachineError(
                f"tools.{name}.link is {link!r}; give one that a joint moves: {moved}"
            )
        if shape not in _SHAPES:
            raise MachineError(f"tools.{name}.shape is {shape!r}; give one of {', '.join(_SHAPES)}")
        if shape == "drum" and axes[link] != "y":
            raise MachineError(
                f"tools.{name} is a drum on {link}, which turns about {axes[link]}; a drum spins"
                " about y: give it a link with such a joint"
            )
        tools[name] = ToolMount(link, _SHAPES[shape](tool))
        tool.done()
    return tools


def _bucket(section: Section) -> ToolShape:
    return BucketShape(
        profile=np.array(section.vectors("profile", KEY_PAIRS, 2)),
        width=section.number("width", positive=True),
        plate=section.number("plate", positive=True),
    )


def _bed(section: Section) -> ToolShape:
    return BedShape(
        profile=np.array(section.vectors("profile", None, 2)),
        width=section.number("width", positive=True),
        plate=section.number("plate", positive=True),
    )


def _drum(section: Section) -> ToolShape:
    return DrumShape(
        radius=section.number("radius", positive=True),
        body=section.number("body", positive=True),
        width=section.number("width", positive=True),
        offset=section.number("offset"),
        vanes=section.count("vanes", low=1),
    )


_SHAPES: dict[str, Callable[[Section], ToolShape]] = {
    "bucket": _bucket,
    "drum": _drum,
    "bed": _bed,
}

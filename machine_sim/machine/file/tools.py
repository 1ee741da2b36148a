"""The tools in a machine file."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from machine_sim.machine.errors import MachineError
from machine_sim.machine.file.section import Section
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.bucket import KEY_PAIRS, BucketShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.machine.tools.shapes import ToolMount, ToolShape

__all__ = ["read_tools"]


def read_tools(section: Section, links: Collection[str]) -> dict[str, ToolMount]:
    """Read `tools`: by name, each with the link that it is fixed to and its shape.

    Args:
        section: of the file.
        links: names of the machine's links.

    Raises:
        MachineError: a shape there is none of, a link there is none of, or numbers out of range.
    """
    tools = {}
    for name in section.names():
        tool = section.section(name)
        link, shape = tool.text("link"), tool.text("shape")
        if link not in links:
            raise MachineError(f"tools.{name}.link is {link!r}; give one of {', '.join(links)}")
        if shape not in _SHAPES:
            raise MachineError(f"tools.{name}.shape is {shape!r}; give one of {', '.join(_SHAPES)}")
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

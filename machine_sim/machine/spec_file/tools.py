"""The tools in a machine file."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import Joint
from machine_sim.machine.spec_file.section import Section
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.bucket import NUM_KEY_POINT_PAIRS, BucketShape
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
        if shape not in _SHAPE_READERS:
            raise MachineError(
                f"tools.{name}.shape is {shape!r}; give one of {', '.join(_SHAPE_READERS)}"
            )
        if shape == "drum" and axes[link] != "y":
            raise MachineError(
                f"tools.{name} is a drum on {link}, which turns about {axes[link]}; a drum spins"
                " about y: give it a link with such a joint"
            )
        tools[name] = ToolMount(link, _SHAPE_READERS[shape](tool))
        tool.reject_unknown_keys()
    return tools


def _read_bucket(section: Section) -> ToolShape:
    return BucketShape(
        profile=np.array(section.vectors("profile", NUM_KEY_POINT_PAIRS, 2)),
        width=section.number("width", positive=True),
        plate_thickness=section.number("plate_thickness", positive=True),
    )


def _read_bed(section: Section) -> ToolShape:
    return BedShape(
        profile=np.array(section.vectors("profile", None, 2)),
        width=section.number("width", positive=True),
        plate_thickness=section.number("plate_thickness", positive=True),
    )


def _read_drum(section: Section) -> ToolShape:
    return DrumShape(
        radius=section.number("radius", positive=True),
        body_radius=section.number("body_radius", positive=True),
        width=section.number("width", positive=True),
        offset=section.number("offset"),
        vanes=section.count("vanes", low=1),
    )


_SHAPE_READERS: dict[str, Callable[[Section], ToolShape]] = {
    "bucket": _read_bucket,
    "drum": _read_drum,
    "bed": _read_bed,
}

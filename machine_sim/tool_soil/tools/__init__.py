"""Kinds of tools: how each acts on soil, registered under its name in machine files.

- `interaction`: the protocol that every kind implements, and null objects
- `plate_cutting`: what tools with a cutting edge have in common
- `bucket`, `blade`, `drum`, `bed`: one kind each; its shape is in `machine_sim.machine.tools`
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from machine_sim.machine.tools.shapes import ToolShape
from machine_sim.tool_soil.tools.bed import BedInteraction
from machine_sim.tool_soil.tools.blade import BladeInteraction
from machine_sim.tool_soil.tools.bucket import BucketInteraction
from machine_sim.tool_soil.tools.drum import DrumInteraction
from machine_sim.tool_soil.tools.interaction import (
    PendingAccount,
    ToolInteraction,
    ToolMotion,
    ToolResistance,
)

__all__ = [
    "TOOL_INTERACTIONS",
    "PendingAccount",
    "ToolInteraction",
    "ToolMotion",
    "ToolResistance",
    "make_interaction",
]

TOOL_INTERACTIONS: dict[str, Callable[[Any, int], ToolInteraction]] = {
    "bucket": BucketInteraction,
    "blade": BladeInteraction,
    "drum": DrumInteraction,
    "bed": BedInteraction,
}
"""Makes the interaction of each kind of tool from its shape and its id."""


def make_interaction(shape: ToolShape, tool_id: int) -> ToolInteraction:
    """Return how a tool of this shape acts on soil.

    Args:
        shape: shape of the tool.
        tool_id: id of the tool in rows.
    """
    return TOOL_INTERACTIONS[shape.kind](shape, tool_id)

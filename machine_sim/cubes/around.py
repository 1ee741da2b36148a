"""Which cubes are in a tool, which beside one, and how the tool moves there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.particles.tool import ToolSet

__all__ = ["Around", "look_around"]


@dataclass(frozen=True)
class Around:
    """The tools as cubes see them; arrays have one row per cube.

    Attributes:
        inside: in the convex hull of a tool.
        beside: in reach of a tool's bounding sphere, or inside one.
        velocity: of the tool there [m/s], map frame; zero away from tools.
        held: inside a tool that digs: its plates keep the terrain away.
        near: beside a tool that digs, where the surface is known only roughly.
    """

    inside: NDArray[np.bool_]
    beside: NDArray[np.bool_]
    velocity: NDArray[np.float64]
    held: NDArray[np.bool_]
    near: NDArray[np.bool_]


def look_around(
    tools: ToolSet, position: NDArray[np.float64], size: NDArray[np.float32], cell: float
) -> Around:
    """Look from every cube to the tools at the start of a step.

    Args:
        tools: with the motion of the step laid out.
        position: centres [m], map frame, shape (n, 3).
        size: edges [m], shape (n,).
        cell: width of a column of the terrain [m].
    """
    n = len(position)
    inside, beside, held, near = np.zeros((4, n), np.bool_)
    around = Around(inside, beside, np.zeros((n, 3)), held, near)
    for tool, twist in zip(tools.tools, tools.twist, strict=True):
        rotation, origin = tool.start
        offset = position - origin
        distance = np.linalg.norm(offset - rotation @ tool.centre, axis=1)
        within = tool.contains(offset @ rotation)
        reached = within | (distance <= tool.reach + size)
        # Of several tools the one that holds the cube counts, else the last in reach.
        counts = within | (reached & ~inside)
        around.velocity[counts] = twist[:3] + np.cross(twist[3:], offset[counts])
        inside |= within
        beside |= reached
        if tool.digs:
            held |= within
            near |= distance <= tool.reach + cell
    return around

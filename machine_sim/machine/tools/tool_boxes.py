"""Tools as boxes: what is seen of them, and what other rigid machines touch."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from machine_sim.machine.spec import Box
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.machine.tools.open_container import OpenContainer
from machine_sim.machine.tools.shapes import ToolShape

__all__ = ["tool_boxes"]

_NUM_SIDE_SLABS = 6
_VANE_THICKNESS = 0.04
"""Thickness of a drum's vanes as drawn [m]."""


def tool_boxes(shape: ToolShape) -> list[Box]:
    """The boxes of a tool, in its frame."""
    return _drum_boxes(shape) if isinstance(shape, DrumShape) else _container_boxes(shape)


def _container_boxes(shape: OpenContainer) -> list[Box]:
    """A box for each strip of the floor, slabs for each side wall."""
    plate_thickness, width, profile = shape.plate_thickness, shape.width, shape.profile
    boxes = []
    for a, b in pairwise(profile):
        middle, edge = 0.5 * (a + b), b - a
        boxes.append(
            Box(
                (float(np.hypot(*edge)), width, plate_thickness),
                (float(middle[0]), 0.0, float(middle[1])),
                math.atan2(-edge[1], edge[0]),
            )
        )
    # A side wall in slabs that stand on the mouth and reach to the shell.
    along = (profile[-1] - profile[0]) / shape.opening_length
    inward = -shape.opening_normal[[0, 2]]
    local = profile - profile[0]
    u, depth = local @ along, local @ inward
    step = shape.opening_length / _NUM_SIDE_SLABS
    for k in range(_NUM_SIDE_SLABS):
        at = (k + 0.5) * step
        high = float(np.interp(at, u, depth))
        x, z = profile[0] + at * along + 0.5 * high * inward
        boxes += [
            Box(
                (step, plate_thickness, high),
                (float(x), side * 0.5 * (width + plate_thickness), float(z)),
                math.atan2(-along[1], along[0]),
            )
            for side in (+1, -1)
        ]
    return boxes


def _drum_boxes(shape: DrumShape) -> list[Box]:
    """An octagon of four boxes, and a box for each vane."""
    flat = 2.0 * shape.body_radius * math.tan(math.pi / 8)
    boxes = [
        Box(
            (2.0 * shape.body_radius, shape.width, flat),
            (0.0, shape.offset, 0.0),
            0.25 * math.pi * k,
        )
        for k in range(4)
    ]
    middle, high = 0.5 * (shape.body_radius + shape.radius), shape.radius - shape.body_radius
    for k in range(shape.vanes):
        angle = 2.0 * math.pi * k / shape.vanes
        at = (middle * math.cos(angle), shape.offset, -middle * math.sin(angle))
        boxes.append(Box((high, shape.width, _VANE_THICKNESS), at, angle))
    return boxes

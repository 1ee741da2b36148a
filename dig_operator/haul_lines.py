"""Lines that a dumper drives along to a place, and where the place lies from it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dig_operator.tip_area import Place
from dig_operator.track_drive import Line

__all__ = ["distance_ahead", "distance_left", "line_to", "polyline"]

Array = NDArray[np.float64]


def distance_ahead(place: Place, position: Array) -> float:
    """Return how far a place lies before a position, along the heading at the place [m]."""
    dx, dy = place.x - float(position[0]), place.y - float(position[1])
    return dx * math.cos(place.yaw) + dy * math.sin(place.yaw)


def distance_left(place: Place, position: Array) -> float:
    """Return how far a place lies to the left of a position, across the heading there [m]."""
    dx, dy = place.x - float(position[0]), place.y - float(position[1])
    return dy * math.cos(place.yaw) - dx * math.sin(place.yaw)


def line_to(place: Place, position: Array) -> Line:
    """Return the line to a place with its heading: in reverse unless it lies ahead."""
    if distance_ahead(place, position) > 0.0:
        return Line((place.x, place.y), place.yaw)
    return Line((place.x, place.y), place.yaw + math.pi, is_reverse=True)


def polyline(start: Array, points: list[tuple[float, float]]) -> list[Line]:
    """Return the lines that lead from a position over points (x, y) [m]."""
    lines = []
    for point in points:
        lines.append(Line.from_to(start, point))
        start = np.array(point)
    return lines

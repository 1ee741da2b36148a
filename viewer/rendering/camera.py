"""Cameras of pictures and films: a named view of a machine, or a fixed pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from viewer.rendering.errors import RenderError

__all__ = ["VIEWS", "Camera", "MachineCamera", "PoseCamera"]

VIEWS = ("orbit", "cab", "top", "bucket")
"""Named views of a machine."""

_FOV_RANGE = (1.0, 150.0)
_MAX_DISTANCE = 1000.0
_MAX_COORDINATE = 1e6

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class MachineCamera:
    """A view that follows a machine.

    Attributes:
        view: one of `VIEWS`.
        machine: namespace of the machine; empty for the first one.
        azimuth: direction from the machine to an orbiting camera [deg], map frame, 0 along +x and
            90 along +y; None for the default.
        elevation: angle of an orbiting camera above the horizon [deg]; None for the default.
        distance: of an orbiting camera from the machine [m]; for one above, the length of ground
            that fits into the picture [m]; None for the default.
        fov: vertical angle of view [deg]; None for that of the view.
    """

    view: str = "orbit"
    machine: str = ""
    azimuth: float | None = None
    elevation: float | None = None
    distance: float | None = None
    fov: float | None = None

    def __post_init__(self) -> None:
        """Validate the values.

        Raises:
            RenderError: a value is out of range.
        """
        if self.view not in VIEWS:
            raise RenderError(f"there is no view {self.view!r}; give one of {', '.join(VIEWS)}")
        _check_range("azimuth", self.azimuth, -360.0, 360.0)
        _check_range("elevation", self.elevation, -89.0, 89.0)
        _check_range("distance", self.distance, 0.5, _MAX_DISTANCE)
        _check_range("fov", self.fov, *_FOV_RANGE)

    def to_message(self) -> dict[str, Any]:
        """Return the camera as it is sent to the page; angles in degrees."""
        values = {
            "view": self.view,
            "machine": self.machine,
            "azimuth": self.azimuth,
            "elevation": self.elevation,
            "distance": self.distance,
            "fov": self.fov,
        }
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class PoseCamera:
    """A fixed camera.

    Attributes:
        position: of the camera [m], map frame.
        target: a point in the middle of the picture [m], map frame.
        up: direction that is up in the picture.
        fov: vertical angle of view [deg].
    """

    position: Vector
    target: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fov: float = 45.0

    def __post_init__(self) -> None:
        """Validate the values.

        Raises:
            RenderError: a value is out of range, or the direction of view is not defined.
        """
        for name in ("position", "target", "up"):
            for value in getattr(self, name):
                _check_range(name, value, -_MAX_COORDINATE, _MAX_COORDINATE)
        _check_range("fov", self.fov, *_FOV_RANGE)
        forward = np.subtract(self.target, self.position)
        across = np.cross(forward, self.up)
        if np.linalg.norm(across) < 1e-6 * max(float(np.linalg.norm(forward)), 1.0):
            raise RenderError(
                "the camera looks along its up direction, or position and target are the same;"
                " change up or target"
            )

    @classmethod
    def around(
        cls,
        target: Vector,
        azimuth: float,
        elevation: float,
        distance: float,
        fov: float = 42.0,
    ) -> PoseCamera:
        """Return a camera that looks at a point.

        Args:
            target: the point [m], map frame.
            azimuth: direction from the point to the camera [deg], 0 along +x, 90 along +y.
            elevation: of the camera above the horizon of the point [deg].
            distance: from the point to the camera [m].
            fov: vertical angle of view [deg].
        """
        level = distance * math.cos(math.radians(elevation))
        position = (
            target[0] + level * math.cos(math.radians(azimuth)),
            target[1] + level * math.sin(math.radians(azimuth)),
            target[2] + distance * math.sin(math.radians(elevation)),
        )
        return cls(position, target, fov=fov)

    def to_message(self) -> dict[str, Any]:
        """Return the camera as it is sent to the page."""
        return {
            "position": list(self.position),
            "target": list(self.target),
            "up": list(self.up),
            "fov": self.fov,
        }


Camera = MachineCamera | PoseCamera


def _check_range(name: str, value: float | None, low: float, high: float) -> None:
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        raise RenderError(f"the {name} of a camera must be {low:g} to {high:g}, not {value}")

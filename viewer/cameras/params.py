"""Parameters of the camera node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from viewer.rendering.picture import MAX_SIZE, MIN_SIZE, PictureSize

__all__ = ["CAMERA_VIEWS", "CameraParams"]

CAMERA_VIEWS = ("cab", "bucket")
"""Views that have a frame in the robot description: `<view>_camera`."""


@dataclass(frozen=True)
class CameraParams(Parameters):
    """Parameters of `camera`."""

    simulation_namespace: str = parameter(
        "", "namespace of the soil node; by default that of this node"
    )
    machines: tuple[str, ...] = parameter(
        (), "namespaces of the machines with cameras; empty: all", items=str
    )
    views: tuple[str, ...] = parameter(
        ("cab",), "cameras of each machine, of cab and bucket", items=str
    )
    width: int = parameter(640, "width of the images", unit="pixels", low=MIN_SIZE, high=MAX_SIZE)
    height: int = parameter(480, "height of the images", unit="pixels", low=MIN_SIZE, high=MAX_SIZE)
    rate: float = parameter(
        5.0,
        "maximum rate of the images of each camera; without a GPU it is lower",
        unit="Hz of simulated time",
        low=0.01,
        high=100.0,
    )
    fov: float = parameter(60.0, "vertical angle of view", unit="deg", low=10.0, high=120.0)
    quality: Literal["low", "medium", "high"] = parameter(
        "low", "detail of the images", choices=("low", "medium", "high")
    )
    gpu: bool = parameter(False, "whether the GPU draws; else the CPU")

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = [view for view in self.views if view not in CAMERA_VIEWS]
        if unknown or not self.views:
            raise ParameterError(
                f"views is {list(self.views)}; give some of {', '.join(CAMERA_VIEWS)}"
            )

    @property
    def size(self) -> PictureSize:
        """Size of the images."""
        return PictureSize(self.width, self.height)

    def has_machine(self, namespace: str) -> bool:
        """Return whether a machine has cameras."""
        names = (name if name.startswith("/") else f"/{name}" for name in self.machines)
        return not self.machines or namespace in names

"""Parameters of the road header's task."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["FaceCuttingParams"]


@dataclass(frozen=True)
class FaceCuttingParams(Parameters):
    """A face and how it is cut; the defaults suit a 24 t road header."""

    width: float = parameter(
        3.6, "width of the face, cutting head included", unit="m", low=1.0, high=20.0
    )
    height: float = parameter(2.2, "height of the face", unit="m", low=0.5, high=10.0)
    advance: float = parameter(0.3, "depth cut in each round", unit="m", low=0.05, high=2.0)
    rounds: int = parameter(2, "number of rounds to cut", low=1, high=1000)
    overlap: float = parameter(
        0.3, "overlap of a pass with the one below, in radii of the head", low=0.0, high=1.5
    )
    head_angular_velocity: float = parameter(
        7.5, "commanded angular velocity of the head", unit="rad/s", low=0.5, high=50.0
    )
    slew_speed: float = parameter(
        0.15, "angular speed of the boom while cutting", unit="rad/s", low=0.01, high=1.0
    )
    sumping_speed: float = parameter(
        0.12, "driving speed into the face", unit="m/s", low=0.01, high=1.0
    )
    max_approach_distance: float = parameter(
        10.0, "distance driven without meeting a face after which the task is aborted", unit="m",
        low=0.0, high=100.0,
    )  # fmt: skip
    timeout: float = parameter(
        600.0, "duration of the task after which it is aborted", unit="s", low=1.0, high=1e6
    )

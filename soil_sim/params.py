"""Parameters of the soil."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["SoilParams"]


@dataclass(frozen=True)
class SoilParams(Parameters):
    """What the terrain is made of and how finely it is worked. Defaults: the 2014 reference."""

    repose_angle: float = parameter(
        30.0, "slope beyond which soil slips", unit="deg", low=1.0, high=80.0
    )
    swell: float = parameter(
        0.0, "part by which bank soil grows when it is loosened", low=0.0, high=1.0
    )
    slip_radius: float = parameter(
        4.0, "radius r of the neighbourhood soil slips into", unit="cells", low=1.0, high=8.0
    )
    slip_tolerance: float = parameter(
        0.002, "excess over tan(angle) left standing at a cell's distance", low=1e-5, high=0.1
    )
    slip_budget: int = parameter(
        20_000, "columns examined for slip in one tick; the rest waits", low=100, high=10**9
    )
    dig_depth: float = parameter(
        20.0, "depth of soil below the lowest point of the map", unit="m", low=0.01, high=1000.0
    )
    cut_mode: str = parameter(
        "swept",
        "swept: area-weighted overlap of the tool; reference: the 2014 key-point rule",
        choices=("swept", "reference"),
    )
    cut_resolution: float = parameter(
        0.025, "size to which columns under a tool are refined", unit="m", low=0.002, high=1.0
    )
    key_points_between: int = parameter(
        8, "reference mode: points interpolated between a left and right key point", low=1, high=64
    )

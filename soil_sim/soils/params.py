"""Parameters of the soil."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from soil_sim.soils.soil_types import SoilType, load_soil_types

__all__ = ["SoilParams"]


@dataclass(frozen=True)
class SoilParams(Parameters):
    """What the terrain is made of and how finely it is worked. Defaults: the 2014 reference."""

    soil: str = parameter(
        "", "kind of soil the ground is of, a name in the file of soils; empty: one without"
        " cohesion that has the repose_angle and the swell given here",
    )  # fmt: skip
    additional_soils: tuple[str, ...] = parameter(
        (), "kinds that a soil map's ids 1, 2, 3 ... mean; 0 is the ground's own", items=str
    )
    soils: str = parameter("soils.yaml", "file of soils: a path, or the name of a shipped one")
    repose_angle: float = parameter(
        30.0, "slope beyond which soil slips, if no soil is named", unit="deg", low=1.0, high=80.0
    )
    swell: float = parameter(
        0.0, "part by which bank soil grows when it is loosened, if no soil is named",
        low=0.0, high=1.0,
    )  # fmt: skip
    moisture: int = parameter(
        -1, "of the ground, of saturation; -1: as its soil has it", unit="%", low=-1, high=100
    )
    relaxation_radius: float = parameter(
        4.0, "radius r of the neighbourhood soil slips into", unit="cells", low=1.0, high=8.0
    )
    relaxation_tolerance: float = parameter(
        0.002, "excess over tan(angle) left standing at a cell's distance", low=1e-5, high=0.1
    )
    max_cell_visits_per_tick: int = parameter(
        20_000, "looks around a column for slip in one tick; the rest waits", low=100, high=10**9
    )
    soil_depth: float = parameter(
        20.0, "depth of soil below the lowest point of the map", unit="m", low=0.01, high=1000.0
    )
    cut_mode: str = parameter(
        "swept",
        "swept: area-weighted overlap of the tool; reference: the 2014 key-point rule",
        choices=("swept", "reference"),
    )
    force_mode: str = parameter(
        "earthmoving",
        "earthmoving: cutting resistance acts on tools; none: the soil exerts no force on tools",
        choices=("earthmoving", "none"),
    )
    cut_resolution: float = parameter(
        0.025, "size to which columns under a tool are refined", unit="m", low=0.002, high=1.0
    )
    num_interpolated_key_points: int = parameter(
        8, "reference mode: points interpolated between a left and right key point", low=1, high=64
    )
    repose_angle_noise: float = parameter(
        0.0, "by how much each column's angle of repose may differ", unit="deg", low=0.0, high=20.0
    )
    redistribution_noise: float = parameter(
        0.0, "how much chance there is in where soil slips to", low=0.0, high=1.0
    )
    surface_tilt_noise: float = parameter(
        0.0, "by how much the surface of loose soil leans to and fro", unit="deg",
        low=0.0, high=45.0,
    )  # fmt: skip
    noise_seed: int = parameter(0, "of all noise", low=0, high=2**31)

    def soil_types(self) -> tuple[SoilType, ...]:
        """The kinds of soil in the ground, by id.

        Raises:
            ParameterError: a name that the file does not have, or an angle beside a name.
            ConfigError, SoilError: a file that is missing or no file of soils.
        """
        if not (self.soil or self.additional_soils):
            return (_cohesionless_soil(self.repose_angle, self.swell),)
        known = load_soil_types(self.soils)
        for name in filter(None, (self.soil, *self.additional_soils)):
            if name not in known:
                raise ParameterError(
                    f"there is no soil {name!r} in {self.soils}; it has {', '.join(known)}"
                )
        if self.soil and (self.repose_angle, self.swell) != (30.0, 0.0):
            raise ParameterError(
                f"the soil is {self.soil!r} and has an angle and a swell of its own; leave"
                " repose_angle and swell out, or leave the name out"
            )
        own = known[self.soil] if self.soil else _cohesionless_soil(self.repose_angle, self.swell)
        return (own, *(known[name] for name in self.additional_soils))


def _cohesionless_soil(angle: float, swell: float) -> SoilType:
    """A soil without cohesion and with one angle, dry or wet."""
    return SoilType(
        repose_angle=angle, repose_angle_damp=angle, repose_angle_wet=angle, swell=swell
    )

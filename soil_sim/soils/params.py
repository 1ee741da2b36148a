"""Parameters of the soil of a run."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from soil_sim.soils.soil_types import SoilType, load_soil_types

__all__ = ["SoilParams"]

_REPOSE_ANGLE = 35.0
_SWELL = 0.15


@dataclass(frozen=True)
class SoilParams(Parameters):
    """Kinds of soil and numerical parameters of the terrain. Default: a loam without cohesion."""

    soil: str = parameter(
        "", "kind of soil of the ground, a name in the file of soils; empty: a soil without"
        " cohesion with repose_angle and swell",
    )  # fmt: skip
    additional_soils: tuple[str, ...] = parameter(
        (), "kinds of soil of the ids 1, 2, 3 ... of a soil map; 0 is `soil`", items=str
    )
    soils: str = parameter("soils.yaml", "file of soils: a path, or the name of a shipped one")
    repose_angle: float = parameter(
        _REPOSE_ANGLE, "angle of repose, if no soil is named", unit="deg", low=1.0, high=80.0
    )
    swell: float = parameter(
        _SWELL, "increase of the volume of bank soil when it is loosened, if no soil is named",
        low=0.0, high=1.0,
    )  # fmt: skip
    moisture: int = parameter(
        -1,
        "moisture of the ground, of saturation; -1: natural moisture of its soil",
        unit="%",
        low=-1,
        high=100,
    )
    relaxation_radius: float = parameter(
        4.0,
        "radius r of the neighbourhood that receives failing soil",
        unit="cells",
        low=1.0,
        high=8.0,
    )
    relaxation_tolerance: float = parameter(
        0.002,
        "excess over tan(repose angle) between adjacent cells that is not relaxed",
        low=1e-5,
        high=0.1,
    )
    max_cell_visits_per_tick: int = parameter(
        20_000,
        "maximum visits of cells by slope failure in one tick; the rest follows in later ticks",
        low=100,
        high=10**9,
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
        0.0,
        "maximum deviation of the angle of repose of each column",
        unit="deg",
        low=0.0,
        high=20.0,
    )
    redistribution_noise: float = parameter(
        0.0, "random variation of the direction in which soil slides", low=0.0, high=1.0
    )
    surface_tilt_noise: float = parameter(
        0.0, "maximum random tilt of the surface of loose soil", unit="deg",
        low=0.0, high=45.0,
    )  # fmt: skip
    noise_seed: int = parameter(0, "seed of all noise", low=0, high=2**31)

    @property
    def is_named(self) -> bool:
        """Whether a kind of soil is read from the file of soils."""
        return bool(self.soil or self.additional_soils)

    def soil_types(self) -> tuple[SoilType, ...]:
        """Return the kinds of soil of the ground, in the order of their ids.

        Raises:
            ParameterError: the file has no soil of a given name, or repose_angle or swell are given
                with a name.
            ConfigError, SoilError: the file is missing or is not a file of soils.
        """
        if not self.is_named:
            find_config(self.soils)  # a wrong name is an error although no soil of it is used
            return (_cohesionless_soil(self.repose_angle, self.swell),)
        known = load_soil_types(self.soils)
        for name in filter(None, (self.soil, *self.additional_soils)):
            if name not in known:
                raise ParameterError(
                    f"there is no soil {name!r} in {self.soils}; it has {', '.join(known)}"
                )
        if self.soil and (self.repose_angle, self.swell) != (_REPOSE_ANGLE, _SWELL):
            raise ParameterError(
                f"soil is {self.soil!r}, whose repose angle and swell are in {self.soils}; leave"
                " repose_angle and swell out, or leave the name out"
            )
        own = known[self.soil] if self.soil else _cohesionless_soil(self.repose_angle, self.swell)
        return (own, *(known[name] for name in self.additional_soils))


def _cohesionless_soil(angle: float, swell: float) -> SoilType:
    """Return a soil without cohesion whose angle [deg] does not depend on moisture."""
    return SoilType(
        repose_angle=angle, repose_angle_damp=angle, repose_angle_wet=angle, swell=swell
    )

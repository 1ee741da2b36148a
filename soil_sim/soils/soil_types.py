"""Properties of kinds of soil, read from `config/soils.yaml`.

A column stores the id of its kind of soil and its moisture in per cent of saturation. Properties
that depend on moisture are given at 0, 50 and 100 % and interpolated linearly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from msg_bridge.config_files import find_config
from msg_bridge.contract.constants import GRAVITY, MOISTURE_LEVELS
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.yaml_text import load_yaml
from soil_sim.errors import SoilError

__all__ = ["SoilTables", "SoilType", "build_soil_tables", "load_soil_types"]


@dataclass(frozen=True)
class SoilType(Parameters):
    """One kind of soil; `config/soils.yaml` states the sources of the shipped values.

    Angles and factors that end in `_damp` and `_wet` apply at 50 and 100 % of saturation.
    """

    repose_angle: float = parameter(
        30.0, "angle of repose of dry loose soil", unit="deg", low=1.0, high=80.0
    )
    repose_angle_damp: float = parameter(
        30.0, "angle of repose, half saturated", unit="deg", low=1.0, high=80.0
    )
    repose_angle_wet: float = parameter(
        30.0, "angle of repose, saturated", unit="deg", low=1.0, high=80.0
    )
    swell: float = parameter(
        0.0, "increase of the bulk volume when loosened, over the bank volume", low=0.0, high=1.0
    )
    shrinkage: float = parameter(
        0.1, "reduction of the volume when packed by tracks, over the bank volume",
        low=0.0, high=0.5,
    )  # fmt: skip
    packed_strength: float = parameter(
        1.0, "cohesion of soil packed by tracks, over that of bank soil", low=0.0, high=100.0
    )
    density: float = parameter(
        1600.0, "density of undisturbed (bank) soil", unit="kg/m3", low=500.0, high=4000.0
    )
    cohesion: float = parameter(
        0.0, "cohesion of undisturbed dry soil", unit="Pa", low=0.0, high=1e8
    )
    adhesion: float = parameter(
        0.0, "adhesion to steel along its surface, dry", unit="Pa", low=0.0, high=1e6
    )
    normal_adhesion: float = parameter(
        0.0, "adhesion across the surface of steel (pull-off), dry; 0: as adhesion",
        unit="Pa", low=0.0, high=1e6,
    )  # fmt: skip
    contact_area: float = parameter(
        0.05, "area on which dry lumps touch one another or steel, over their cross section",
        low=0.0, high=1.0,
    )  # fmt: skip
    contact_area_damp: float = parameter(
        0.05, "the same for lumps half saturated", low=0.0, high=1.0
    )
    contact_area_wet: float = parameter(
        0.05, "the same for saturated lumps: plastic ones spread", low=0.0, high=1.0
    )
    strength_factor_damp: float = parameter(
        1.0, "cohesion and adhesion half saturated, over dry", low=0.0, high=100.0
    )
    strength_factor_wet: float = parameter(
        1.0, "cohesion and adhesion saturated, over dry", low=0.0, high=100.0
    )
    internal_friction: float = parameter(
        30.0, "angle of internal friction", unit="deg", low=0.0, high=60.0
    )
    tool_friction: float = parameter(
        20.0, "angle of friction against steel", unit="deg", low=0.0, high=45.0
    )
    compressive_strength: float = parameter(
        0.0, "uniaxial compressive strength of rock; 0: soil", unit="Pa", low=0.0, high=5e8
    )
    tensile_strength: float = parameter(
        0.0, "tensile strength of rock; 0: soil", unit="Pa", low=0.0, high=5e7
    )
    bekker_k_c: float = parameter(
        0.0, "Bekker's k_c, dry: tracks sink to the depth z under (k_c / b + k_phi) z^n",
        unit="N/m^(n+1)", low=0.0, high=1e9,
    )  # fmt: skip
    bekker_k_phi: float = parameter(
        0.0, "Bekker's k_phi, dry; 0: rigid under tracks, with Coulomb friction",
        unit="N/m^(n+2)", low=0.0, high=1e9,
    )  # fmt: skip
    bekker_n: float = parameter(1.0, "Bekker's n", low=0.05, high=2.0)
    bekker_factor_damp: float = parameter(
        1.0, "k_c and k_phi half saturated, over dry", low=0.001, high=100.0
    )
    bekker_factor_wet: float = parameter(
        1.0, "k_c and k_phi saturated, over dry", low=0.001, high=100.0
    )
    janosi_k: float = parameter(
        0.01, "shear deformation modulus K: shear displacement at 63 % of the shear strength",
        unit="m", low=0.001, high=0.2,
    )  # fmt: skip
    lump_size_spread: float = parameter(
        0.0, "maximum relative deviation of lump volumes from their mean", low=0.0, high=0.9
    )
    moisture: int = parameter(0, "natural moisture, of saturation", unit="%", low=0, high=100)
    colour: tuple[float, ...] = parameter(
        (0.55, 0.42, 0.3), "colour of dry soil: red, green, blue", low=0.0, high=1.0
    )
    sources: str = parameter("", "sources of the values")

    def __post_init__(self) -> None:
        """Validate combinations of parameters."""
        super().__post_init__()
        if len(self.colour) != 3:
            raise ParameterError(f"colour has {len(self.colour)} values; give red, green and blue")
        if (self.compressive_strength > 0.0) != (self.tensile_strength > 0.0):
            raise ParameterError(
                "only one of compressive_strength and tensile_strength is above 0; give both for"
                " rock, none for soil"
            )

    @property
    def is_rock(self) -> bool:
        """Whether picks and teeth cut it as rock."""
        return self.compressive_strength > 0.0

    def repose_angle_at(self, moisture: float) -> float:
        """Return the angle of repose [rad] at a moisture [%]."""
        angles = (self.repose_angle, self.repose_angle_damp, self.repose_angle_wet)
        return math.radians(float(np.interp(moisture, (0.0, 50.0, 100.0), angles)))

    def moisture_strength_factor(self, moisture: float) -> float:
        """Return cohesion and adhesion at a moisture [%], over those of dry soil."""
        factors = (1.0, self.strength_factor_damp, self.strength_factor_wet)
        return float(np.interp(moisture, (0.0, 50.0, 100.0), factors))

    @property
    def loose_soil(self) -> LooseSoil:
        """Properties that machines receive. Broken rock has no cohesion."""
        return LooseSoil(
            swell=self.swell,
            density=self.density,
            repose_angles=(self.repose_angle, self.repose_angle_damp, self.repose_angle_wet),
            cohesion=0.0 if self.is_rock else self.cohesion,
            adhesion=self.adhesion,
            normal_adhesion=self.normal_adhesion,
            contact_areas=(self.contact_area, self.contact_area_damp, self.contact_area_wet),
            moisture_strength_factors=(1.0, self.strength_factor_damp, self.strength_factor_wet),
            tool_friction=self.tool_friction,
            size_spread=self.lump_size_spread,
            moisture=self.moisture,
            internal_friction=self.internal_friction,
            bekker_k_c=self.bekker_k_c,
            bekker_k_phi=self.bekker_k_phi,
            bekker_n=self.bekker_n,
            moisture_bearing_factors=(1.0, self.bekker_factor_damp, self.bekker_factor_wet),
            janosi_k=self.janosi_k,
        )

    def critical_height(self, moisture: float) -> float:
        """Return the maximum height [m] of a stable vertical face of undisturbed soil.

        4 c / gamma * tan(45 deg + phi / 2), the critical height of a vertical cut (Terzaghi,
        Theoretical Soil Mechanics, 1943, art. 57), without tension cracks.
        """
        cohesion = self.cohesion * self.moisture_strength_factor(moisture)
        passive = math.tan(math.pi / 4 + math.radians(self.internal_friction) / 2)
        return 4.0 * cohesion / (self.density * GRAVITY) * passive


class SoilTables(NamedTuple):
    """Properties of kinds of soil for kernels, by soil id, or by soil id and moisture [%].

    Attributes:
        bulking_factor: bulk volume of loosened soil over its bank volume, shape (kinds,).
        shrinkage: reduction of the volume of packed soil over its bank volume, shape (kinds,).
        repose_tan: tangent of the angle of repose, shape (kinds, MOISTURE_LEVELS).
        critical_height: maximum height of a stable vertical face of firm soil [m], shape
            (kinds, MOISTURE_LEVELS).
        internal_friction: angle of internal friction [rad], shape (kinds,).
    """

    bulking_factor: NDArray[np.float64]
    shrinkage: NDArray[np.float64]
    repose_tan: NDArray[np.float64]
    critical_height: NDArray[np.float64]
    internal_friction: NDArray[np.float64]


def build_soil_tables(kinds: Sequence[SoilType]) -> SoilTables:
    """Return the tables of kinds of soil.

    Args:
        kinds: the kinds of soil, in the order of their ids.

    Raises:
        SoilError: there are no kinds, or more than 256.
    """
    if not 1 <= len(kinds) <= 256:
        raise SoilError(f"there are {len(kinds)} kinds of soil; give 1 to 256")
    return SoilTables(
        np.array([1.0 + kind.swell for kind in kinds]),
        np.array([kind.shrinkage for kind in kinds]),
        np.array(
            [[math.tan(kind.repose_angle_at(m)) for m in range(MOISTURE_LEVELS)] for kind in kinds]
        ),
        np.array([[kind.critical_height(m) for m in range(MOISTURE_LEVELS)] for kind in kinds]),
        np.radians([kind.internal_friction for kind in kinds]),
    )


def load_soil_types(name: str = "soils.yaml") -> dict[str, SoilType]:
    """Read the kinds of soil of a file, by name, in the order of the file.

    Args:
        name: path of the file, or the name of a shipped one.

    Raises:
        ConfigError: there is no such file.
        SoilError: the file is not a mapping of names to properties.
        ParameterError: a property is unknown or out of range.
    """
    path = find_config(name)
    content = _read_yaml_mapping(path)
    kinds = {}
    for soil, properties in content.items():
        if not isinstance(properties, dict):
            raise SoilError(f"{path}: {soil!r} must be a mapping of properties, not {properties!r}")
        try:
            kinds[str(soil)] = SoilType.from_mapping(properties)
        except ParameterError as error:
            raise ParameterError(f"{path}: {soil}: {error}") from None
    return kinds


def _read_yaml_mapping(path: Path) -> dict[Any, Any]:
    try:
        content = load_yaml(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise SoilError(f"{path} is not valid YAML: {error}") from None
    if not isinstance(content, dict) or not content:
        raise SoilError(f"{path} must map names of soils to their properties")
    return content

"""Bearing capacity and shear strength of soil under a sole (Bekker; Janosi and Hanamoto).

On deformable soil the pressure at depth z below the undisturbed ground is Bekker's,
p = (k_c / b + k_phi) z^n with track width b, limited by the spring of the contact. Nearly all
sinkage is plastic: on unloading the sole follows the spring back, and the next sole at the same
place carries load only where it reaches the same depth again. Along the ground the force is
limited by the Mohr-Coulomb strength A c + W tan(phi), and by the friction of the sole's steel. The
strength is mobilised with the shear displacement j of the soil since the sole came down, by
1 - exp(-j / K) (Janosi and Hanamoto, 1961), so that the slip of a track increases with its pull.
(Wong, Theory of Ground Vehicles, sections 2.3 and 2.4.)

On rigid ground only the spring of the contact and Coulomb friction act.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.kernels import helper

__all__ = [
    "BEKKER_MODULUS",
    "BEKKER_N",
    "COHESION",
    "JANOSI_K",
    "TAN_FRICTION",
    "SoilPatch",
    "bearing_force",
    "nearest_cell",
    "shear_strength",
    "soil_coefficients",
    "soil_patch_under",
]

BEKKER_MODULUS, BEKKER_N, COHESION, TAN_FRICTION, JANOSI_K = range(5)
"""Slots of `soil_coefficients`."""


class SoilPatch(NamedTuple):
    """Ground under soles of one width.

    Attributes:
        undisturbed_surface: contact surface before compaction by tracks [m], shape (rows, cols).
        max_sinkage: maximum depth of a sole below that surface so far [m], shape (rows, cols);
            updated by the soles.
        soil, moisture: soil id and moisture [% of saturation], shape (rows, cols), uint8.
        coefficients: `soil_coefficients`, shape (soils, 101, 5).
        frame: `Ground.frame`.
    """

    undisturbed_surface: NDArray[np.float64]
    max_sinkage: NDArray[np.float64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    coefficients: NDArray[np.float64]
    frame: tuple[float, float, float]


def soil_patch_under(ground: Ground, width: float) -> SoilPatch:
    """Return the ground under tracks of a width [m]; it shares the arrays of `ground`."""
    return SoilPatch(
        ground.undisturbed_surface,
        ground.max_sinkage,
        ground.soil,
        ground.moisture,
        soil_coefficients(ground.soils, width),
        ground.frame,
    )


def soil_coefficients(soils: Sequence[LooseSoil], width: float) -> NDArray[np.float64]:
    """Return the coefficients of each soil under tracks of a width [m].

    Returns:
        Array of shape (soils, 101, 5), by soil id, moisture [%] and slot: `BEKKER_MODULUS`
        k_c / b + k_phi [N/m^(n + 2)] (0 for rigid ground), `BEKKER_N`, `COHESION` [Pa],
        `TAN_FRICTION` tan(phi), `JANOSI_K` [m].
    """
    table = np.zeros((len(soils), MOISTURE_LEVELS, 5))
    for coefficients, soil in zip(table, soils, strict=True):
        if soil.bekker_k_phi == 0.0:
            continue
        modulus = soil.bekker_k_c / width + soil.bekker_k_phi
        coefficients[:, BEKKER_MODULUS] = [
            modulus * soil.moisture_bearing_factor(moisture) for moisture in range(MOISTURE_LEVELS)
        ]
        coefficients[:, BEKKER_N] = soil.bekker_n
        coefficients[:, COHESION] = [
            soil.cohesion * soil.moisture_strength_factor(moisture)
            for moisture in range(MOISTURE_LEVELS)
        ]
        coefficients[:, TAN_FRICTION] = math.tan(math.radians(soil.internal_friction))
        coefficients[:, JANOSI_K] = soil.janosi_k
    return table


@helper(forceinline=True)
def nearest_cell(soil, point):  # type: ignore[no-untyped-def]
    """Return row and column of the grid point nearest to a position, clamped to the map."""
    rows, cols = soil.undisturbed_surface.shape
    x_first, y_first, inverse_cell = soil.frame
    row = int(min(max((x_first - point[0]) * inverse_cell + 0.5, 0.0), rows - 1.0))
    col = int(min(max((y_first - point[1]) * inverse_cell + 0.5, 0.0), cols - 1.0))
    return row, col


@helper(forceinline=True)
def bearing_force(depth, max_depth, area, stiffness, coefficients):  # type: ignore[no-untyped-def]
    """Return the normal force of deformable soil on part of a sole, without damping [N].

    Args:
        depth, max_depth: present and maximum depth below the undisturbed ground [m].
        area: area of the part [m^2].
        stiffness: normal stiffness of the contact [N/m].
        coefficients: modulus and exponent of Bekker's law.
    """
    modulus, exponent = coefficients
    bearing = area * modulus * max_depth**exponent
    return min(bearing, stiffness * max_depth) - stiffness * (max_depth - depth)


@helper(forceinline=True)
def shear_strength(displacement, load, area, max_force, coefficients):  # type: ignore[no-untyped-def]
    """Return the maximum tangential force of deformable soil on part of a sole [N].

    Args:
        displacement: shear displacement since the sole came down [m].
        load: normal load [N].
        area: area of the part [m^2].
        max_force: friction limit of the sole's steel [N].
        coefficients: cohesion [Pa], tan(phi) and K [m].
    """
    cohesion, tan_friction, janosi_k = coefficients
    strength = min(area * cohesion + load * tan_friction, max_force)
    return strength * (1.0 - math.exp(-displacement / janosi_k))

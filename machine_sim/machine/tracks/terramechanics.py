"""What the ground does to a shoe: it gives under it, and lets itself be sheared.

On soil that gives, a sole is borne by Bekker's pressure at its depth z below the ground as it was
before tracks pressed it, p = (k_c / b + k_phi) z^n, b the breadth of the track, and no more than
the contact's spring. Nearly all of that is lasting: lifted, the sole follows the spring back, and
the next one at that place is borne anew only where it comes as deep. Along the ground a sole is
held up to Mohr-Coulomb's strength, A c + W tan(phi), at most by the friction of its steel; soil has
as much of that as it is sheared, 1 - exp(-j / K) (Janosi and Hanamoto, 1961), j the way that the
sole has gone since it came down. So tracks slip more the more they pull. (Wong, Theory of Ground
Vehicles, sections 2.3 and 2.4.)

Ground that does not give is the spring and Coulomb's friction alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground, surface_at
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.kernels import kernel

__all__ = ["SoilPatch", "soil_coefficients", "soil_patch_under", "sole_force"]

_NUM_MOISTURE_LEVELS = 101
"""Steps of moisture: 0 to 100 % of saturation."""


class SoilPatch(NamedTuple):
    """The ground as shoes of one breadth feel it; arrays have shape (rows, cols)."""

    undisturbed_surface: NDArray[np.float64]  # contact surface before tracks pressed it [m]
    max_sinkage: NDArray[np.float64]  # how far a sole has been below that [m]; soles write it
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    coefficients: NDArray[np.float64]  # `soil_coefficients`
    frame: tuple[float, float, float]  # `Ground.frame`


def soil_patch_under(ground: Ground, breadth: float) -> SoilPatch:
    """The ground under tracks `breadth` [m] broad; it stays the ground's own."""
    coefficients = soil_coefficients(ground.soils, breadth)
    return SoilPatch(
        ground.undisturbed_surface,
        ground.max_sinkage,
        ground.soil,
        ground.moisture,
        coefficients,
        ground.frame,
    )


def soil_coefficients(soils: Sequence[LooseSoil], breadth: float) -> NDArray[np.float64]:
    """What tracks of a breadth [m] feel of each soil, by id and moisture, shape (soils, 101, 5).

    Modulus k_c / b + k_phi [N/m^(n + 2)], 0 where it does not give, exponent n, cohesion c [Pa],
    tan(phi), K [m].
    """
    coefficients = np.zeros((len(soils), _NUM_MOISTURE_LEVELS, 5))
    for law, soil in zip(coefficients, soils, strict=True):
        if soil.bekker_k_phi == 0.0:
            continue
        modulus = soil.bekker_k_c / breadth + soil.bekker_k_phi
        law[:, 0] = [
            modulus * soil.moisture_bearing_factor(moisture)
            for moisture in range(_NUM_MOISTURE_LEVELS)
        ]
        law[:, 1] = soil.bekker_n
        law[:, 2] = [
            soil.cohesion * soil.moisture_strength_factor(moisture)
            for moisture in range(_NUM_MOISTURE_LEVELS)
        ]
        law[:, 3] = math.tan(math.radians(soil.internal_friction))
        law[:, 4] = soil.janosi_k
    return coefficients


@kernel(inline="always")
def sole_force(  # type: ignore[no-untyped-def]
    px,
    py,
    pz,
    vx,
    vy,
    vz,
    coefficients,
    area,
    undisturbed_surface,
    max_sinkage,
    soils,
    moistures,
    table,
    frame,
    anchors,
    active,
    shear_displacement,
    i,
):
    """What a part of a sole feels: force (fx, fy, fz), normal load [N] and depth [m].

    Args:
        px, py, pz, vx, vy, vz: where it is [m], and its velocity [m/s].
        laws: kn, cn, kt, ct of the contact and the friction coefficient of its steel.
        area: of that part [m^2].
        level, sunk, soils, moistures, table, frame: of a `Bed`; one by one, as numba is quicker so.
        anchors, active, sheared: bristles of all parts, shape (n, 3), whether they touch, and how
            far they have sheared the soil for good [m], shapes (n,); updated.
        i: number of the part.
    """
    kn, cn, kt, ct, mu = coefficients
    x_first, y_first, inverse_cell = frame
    height, slope_x, slope_y = surface_at(
        undisturbed_surface, x_first, y_first, inverse_cell, px, py
    )
    nz = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    depth = (height - pz) * nz
    if not depth > 0.0:
        active[i] = False
        return 0.0, 0.0, 0.0, 0.0, 0.0
    rows, cols = undisturbed_surface.shape
    row = int(min(max((x_first - px) * inverse_cell + 0.5, 0.0), rows - 1.0))
    col = int(min(max((y_first - py) * inverse_cell + 0.5, 0.0), cols - 1.0))
    kind, moisture = soils[row, col], moistures[row, col]
    modulus = table[kind, moisture, 0]
    gives = modulus > 0.0
    spring = kn * depth
    if gives:
        most = max(depth, max_sinkage[row, col])
        bearing = area * modulus * most ** table[kind, moisture, 1]
        spring = min(bearing, kn * most) - kn * (most - depth)
    nx, ny = -slope_x * nz, -slope_y * nz
    vn = vx * nx + vy * ny + vz * nz
    load = spring - cn * vn
    if not (spring > 0.0 and load > 0.0):  # it lifts off faster than the soil follows
        active[i] = False
        return 0.0, 0.0, 0.0, 0.0, 0.0
    if not active[i]:
        active[i] = True
        anchors[i, 0], anchors[i, 1], anchors[i, 2] = px, py, pz
        shear_displacement[i] = 0.0
    ux, uy, uz = px - anchors[i, 0], py - anchors[i, 1], pz - anchors[i, 2]
    un = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - un * nx, uy - un * ny, uz - un * nz
    fx = -kt * ux - ct * (vx - vn * nx)
    fy = -kt * uy - ct * (vy - vn * ny)
    fz = -kt * uz - ct * (vz - vn * nz)
    force, limit, way = math.sqrt(fx * fx + fy * fy + fz * fz), mu * load, 0.0
    if gives:
        max_sinkage[row, col] = most
        way = shear_displacement[i] + math.sqrt(ux * ux + uy * uy + uz * uz)
        cohesion, friction = table[kind, moisture, 2], table[kind, moisture, 3]
        strength = min(area * cohesion + load * friction, limit)
        limit = strength * (1.0 - math.exp(-way / table[kind, moisture, 4]))
    if force > limit:
        share = limit / force
        fx, fy, fz = share * fx, share * fy, share * fz
        # The anchor follows, so that the spring alone gives the sliding force.
        anchors[i, 0], anchors[i, 1], anchors[i, 2] = px + fx / kt, py + fy / kt, pz + fz / kt
        shear_displacement[i] = max(way - limit / kt, 0.0)
    return fx + load * nx, fy + load * ny, fz + load * nz, load, depth

"""Milled cut: a drum removes soil of its envelope, as far as the work that it delivers suffices.

The soil that the envelope of the pick tips sweeps costs its specific energy
(`soil_sim.tool_force.specific_energy`) times its volume. The terrain has no overhangs: the soil
above the drum is removed with that of its envelope, at the same cost, so that a face costs its
whole volume whichever row of it is cut first. Where the work of the tick does not cover the sum,
all columns lose the same fraction, loose soil before firm soil; the rest stays and is milled by
the work of the next ticks.

What remains stands in the way of the drum. Each subcolumn within the envelope is attributed to the
nearest surface, the cylinder or an end, and pushes the drum along its normal. The result states
where soil was engaged and where soil remains, and the force that each can exert.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.excavation.rasterize import apply_height_changes, rasterize_sweep
from soil_sim.excavation.rasterize_triangle import raster_in_tick
from soil_sim.excavation.refined_columns import (
    MOMENT_X,
    MOMENT_Y,
    MOMENT_Z,
    REMOVED_HEIGHT,
)
from soil_sim.tool_force.bearing_capacity import bearing_capacity
from soil_sim.tool_force.specific_energy import firm_specific_energy, loose_specific_energy
from soil_sim.vec3 import add, divide, dot, norm, scale, subtract

__all__ = ["CONTACT_FORCE", "CONTACT_POINT", "ENGAGED", "REMAINING", "Milling", "mill_sweep"]

ENGAGED, REMAINING = range(2)
"""Slots of `Milling.contacts`: all soil that the envelope swept, and what was not removed of it."""

CONTACT_POINT, CONTACT_FORCE = range(2)
"""Slots of a contact."""


class Milling(NamedTuple):
    """What a drum engaged in a tick.

    Attributes:
        machine_id: id of its machine.
        tool: id of the drum.
        work: work that removed soil [J].
        contacts: of the engaged and of the remaining soil its centre [m], map frame, and the force
            that it can exert on the drum [N], zero without soil, shape (2, 2, 3).
    """

    machine_id: int
    tool: int
    work: float
    contacts: NDArray[np.float64]


_MIN_REMAINING_HEIGHT = 1e-4
"""Height of a subcolumn above the envelope below which it counts as removed [m]."""

_MAX_FORCE = 1e8
"""Maximum force of a FORCE row [N], far beyond what any machine can push with."""

_DIRECTION, _POINT, _STRENGTH, _DEPTH, _VOLUME, _NUM_SUMS = 0, 3, 6, 7, 8, 9
"""Slots of the sums over subcolumns, weighted by the volume within the envelope: direction out of
the soil (3), point (3), bearing capacity, penetration; and that volume."""


@kernel
def mill_sweep(  # type: ignore[no-untyped-def]
    points, has_plate, work, boxed_raster, tick, count, boxed_columns, strength, contacts
):
    """Lower subcolumns to the surface that a drum sweeps, as far as its work suffices.

    Args:
        points: key points at both times and ends, shape (pairs, 2 times, 2 ends, 3), map frame [m].
        has_plate: whether a plate joins each pair to the next one, shape (pairs,).
        work: work that the drum can deliver [J].
        boxed_raster: `RasterTables`, boxed; their refined columns are changed.
        tick: number of the tick.
        count: number of refined columns.
        boxed_columns: `ColumnArrays` of the terrain, boxed.
        strength: `strength_table` of its kinds of soil.
        contacts: see `Milling`, zero; set.

    Returns:
        (Number of refined columns, work that removed soil [J]).
    """
    raster, columns = raster_in_tick(boxed_raster.table, tick), boxed_columns.table
    apply_height_changes(raster, count)
    known = raster.subcolumn_height[:count].copy()
    num_known = count
    count = rasterize_sweep(points, has_plate, raster, count)
    drum = _envelope(points)
    energies = np.empty((count, 2))  # of the loose and of the firm soil within the sweep [J]
    volumes = np.empty((count, 2))  # [m^3]
    sums = np.zeros((2, _NUM_SUMS))
    loose_energy, firm_energy = 0.0, 0.0
    for slot in range(count):
        _find_energies(slot, drum, raster, columns, strength, energies, volumes)
        loose_energy += energies[slot, 0]
        firm_energy += energies[slot, 1]
    loose_fraction = 1.0 if work >= loose_energy else work / loose_energy
    work -= loose_fraction * loose_energy
    firm_fraction = 0.0
    if loose_fraction == 1.0:
        firm_fraction = 1.0 if work >= firm_energy else work / firm_energy
    used = loose_fraction * loose_energy + firm_fraction * firm_energy
    for slot in range(count):
        volume = volumes[slot, 0] + volumes[slot, 1]
        if volume <= 0.0:
            continue
        removed = loose_fraction * volumes[slot, 0] + firm_fraction * volumes[slot, 1]
        _restore(slot, removed / volume, known, num_known, drum, raster, columns, strength, sums)
    for n in range(2):
        _reduce(sums[n], contacts[n])
    return count, used


@helper
def _end_point(points, n, side):  # type: ignore[no-untyped-def]
    """Return the left (0) or right (1) key point of pair n at the end of the tick [m]."""
    return points[n, 1, side, 0], points[n, 1, side, 1], points[n, 1, side, 2]


@helper
def _envelope(points):  # type: ignore[no-untyped-def]
    """Return the envelope of a drum at the end of its tick.

    Returns:
        (middle of its axis, unit vector along it, half of its length, radius) [m].
    """
    num_pairs = points.shape[0]
    left, right = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    num_distinct = max(num_pairs - 1, 1)  # the last pair repeats the first
    for n in range(num_distinct):
        left = add(left, scale(1.0 / num_distinct, _end_point(points, n, 0)))
        right = add(right, scale(1.0 / num_distinct, _end_point(points, n, 1)))
    across = subtract(left, right)
    length = max(norm(across), 1e-6)
    radius = norm(subtract(_end_point(points, 0, 0), left))
    return scale(0.5, add(left, right)), divide(across, length), 0.5 * length, max(radius, 1e-6)


@helper
def _find_energies(slot, drum, raster, columns, strength, energies, volumes):  # type: ignore[no-untyped-def]
    """Set energy and volume of the loose and of the firm soil that the sweep takes of a column."""
    energies[slot, :] = 0.0
    volumes[slot, :] = 0.0
    height = raster.removed_moments[slot, REMOVED_HEIGHT] / raster.subcolumn_height.shape[1]
    if height <= 0.0:
        return
    i, diameter = raster.cells[slot], 2.0 * drum[3]
    area = raster.grid.cell * raster.grid.cell
    volume = height * area
    loose = min(columns.bulk[i] * columns.metres_per_mm3 * area, volume)
    volumes[slot, 0], volumes[slot, 1] = loose, volume - loose
    if loose > 0.0:
        energies[slot, 0] = loose * loose_specific_energy(i, diameter, columns, strength)
    energies[slot, 1] = (volume - loose) * firm_specific_energy(i, diameter, columns, strength)


@helper
def _restore(slot, fraction, known, num_known, drum, raster, columns, strength, sums):  # type: ignore[no-untyped-def]
    """Give back to the subcolumns of a column all but a fraction of what they lost in a sweep.

    Adds the soil within the envelope to `sums`: [0] that of before, [1] what remains.
    """
    grid, moments = raster.grid, raster.removed_moments
    per_side, cell = grid.subcolumns_per_side, raster.cells[slot]
    fine = grid.cell / per_side
    shift = 0.5 * per_side - 0.5
    row, col = cell // grid.cols, cell % grid.cols
    capacity = bearing_capacity(cell, 2.0 * drum[3], 0.0, columns, strength)
    moments[slot, :] = 0.0
    for q in range(raster.subcolumn_height.shape[1]):
        before = known[slot, q] if slot < num_known else raster.initial_height[slot]
        envelope = raster.subcolumn_height[slot, q]
        lost = before - envelope
        if lost <= 0.0:
            continue
        x = grid.x_first + (shift - (row * per_side + q // per_side)) * fine
        y = grid.y_first + (shift - (col * per_side + q % per_side)) * fine
        removed = fraction * lost
        after = before - removed
        raster.subcolumn_height[slot, q] = after
        moments[slot, REMOVED_HEIGHT] += removed
        moments[slot, MOMENT_X] += removed * x
        moments[slot, MOMENT_Y] += removed * y
        moments[slot, MOMENT_Z] += removed * (after + 0.5 * removed)
        _add_contact((x, y), envelope, before, fine, capacity, drum, sums[ENGAGED])
        if lost - removed > _MIN_REMAINING_HEIGHT:
            _add_contact((x, y), envelope, after, fine, capacity, drum, sums[REMAINING])


@helper
def _add_contact(at, bottom, top, fine, capacity, drum, sums):  # type: ignore[no-untyped-def]
    """Add the part of a subcolumn within the envelope to sums.

    Args:
        at: position (x, y) of the subcolumn [m].
        bottom: height of the envelope's lower surface [m].
        top: height of the subcolumn [m].
        fine: side length of the subcolumn [m].
        capacity: bearing capacity of its soil [Pa].
        drum: `_envelope` of the drum.
        sums: see `_DIRECTION`; changed.
    """
    center, along, half_length, radius = drum
    # The envelope reaches as far above its axis as below it.
    axis_height = center[2]
    horizontal = along[0] * along[0] + along[1] * along[1]
    if horizontal > 0.25:
        offset = (at[0] - center[0]) * along[0] + (at[1] - center[1]) * along[1]
        axis_height += along[2] * offset / horizontal
    height = min(top, 2.0 * axis_height - bottom) - bottom
    height = max(height, 1e-3)
    point = at[0], at[1], bottom + 0.5 * height
    arm = subtract(point, center)
    lateral = dot(arm, along)
    outward = subtract(arm, scale(lateral, along))
    distance = norm(outward)
    depth, direction = radius - distance, (0.0, 0.0, 1.0)
    if distance > 1e-6:
        direction = scale(-1.0 / distance, outward)
    if half_length - abs(lateral) < depth:
        depth = half_length - abs(lateral)
        direction = scale(-1.0 if lateral > 0.0 else 1.0, along)
    volume = height * fine * fine
    for axis in range(3):
        sums[_DIRECTION + axis] += volume * direction[axis]
        sums[_POINT + axis] += volume * point[axis]
    sums[_STRENGTH] += volume * capacity
    sums[_DEPTH] += volume * max(2.0 * depth, fine)
    sums[_VOLUME] += volume


@helper
def _reduce(sums, contact):  # type: ignore[no-untyped-def]
    """Set the contact of the soil of some sums: its centre, and the force that it can exert.

    The area of contact is the volume over its depth, which is twice the mean penetration.
    """
    volume = sums[_VOLUME]
    if volume <= 0.0:
        return
    area = volume * volume / sums[_DEPTH]
    # Soil on opposite sides of the drum bears it without a net force.
    limit = _MAX_FORCE * volume
    for axis in range(3):
        contact[CONTACT_POINT, axis] = sums[_POINT + axis] / volume
        direction = sums[_DIRECTION + axis] / volume
        contact[CONTACT_FORCE, axis] = direction * min(area * sums[_STRENGTH], limit) / volume

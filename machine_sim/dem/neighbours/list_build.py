"""The stages of a build of the pair list, in one call.

skin widths -> cells -> pairs -> history of contacts
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from machine_sim.dem.neighbours.cell_grid import rows_in_box, sort_into_cells
from machine_sim.dem.neighbours.history_transfer import transfer_history
from machine_sim.dem.neighbours.pair_search import SearchParticles, find_pairs, mark_active
from machine_sim.dem.neighbours.skin_widths import (
    compute_skin_widths,
    predict_contact_radii,
)
from msg_bridge.kernels import helper, threaded_stages

__all__ = ["ListLimits", "build_list"]


class ListLimits(NamedTuple):
    """Limits of a pair list.

    Attributes:
        base_width: skin width of a particle at rest [m].
        max_skin_diameters: maximum skin width of a particle in a cell, in maximum diameters, of a
            list that is valid for more than one step.
        max_fast_outliers: maximum number of fast outliers.
    """

    base_width: float
    max_skin_diameters: float
    max_fast_outliers: int


@threaded_stages
def build_list(  # type: ignore[no-untyped-def]
    dt, limits, growth, tracked_rows, boxed_particles, boxed_old, old_count, boxed_new, active,
    listed,
):  # fmt: skip
    """Fill a pair table, and carry the contact history over from the previous one.

    Args:
        dt: length of the next steps [s].
        limits: `ListLimits`.
        growth: `GrowthPrediction` of the lifetime of a list.
        tracked_rows: rows whose motion counts, at least one: all particles, or those that move.
        boxed_particles: `ParticleColumns`, boxed.
        boxed_old, old_count: `ListedPairs` of the previous table, boxed, and number of its pairs;
            see `transfer_history`.
        boxed_new: `ListedPairs` of the new table, boxed; the pairs are filled.
        active: out, whether each row is active.
        listed: out, `ListedParticles`.

    Returns:
        (number of pairs, -1 where the table is too small and the history was not carried over;
        number of old pairs that are both asleep; whether active particles are few, so that pairs
        reach into the slabs on both sides; number of fast outliers; first pair of each slab, and
        the end).
    """
    particles, old, new = boxed_particles.table, boxed_old.table.arrays, boxed_new.table.arrays
    position, count = particles.position, particles.radius.size
    begin, end = np.zeros(count, np.int64), np.zeros(count, np.int64)  # pairs of each row
    listed.position[:] = position
    listed.skin_width[:] = 0.0
    predict_contact_radii(
        particles.contact_radius, particles.radius, growth, listed.predicted_radius
    )
    max_travel = 2.0 * limits.max_skin_diameters * np.float64(particles.radius.max())
    max_skin_width, fast_outliers = compute_skin_widths(
        tracked_rows, tracked_rows.size == count, particles.velocity, dt, limits.base_width,
        max_travel, limits.max_fast_outliers, listed.skin_width,
    )  # fmt: skip
    cell_size = 2.0 * listed.predicted_radius.max() + 2.0 * max_skin_width
    mark_active(particles, active)
    sparse = active.sum() * 2 < count
    rows = rows_in_box(position, tracked_rows, cell_size) if sparse else np.arange(count)
    rows = _without(fast_outliers, rows, count)
    searched = SearchParticles(position, listed.predicted_radius + listed.skin_width, active)
    grid = sort_into_cells(rows, position, cell_size)
    slabs = np.zeros(grid.shape[1] + 1, np.int64)
    num_pairs = find_pairs(
        grid, fast_outliers, sparse, searched, new.first, new.second, begin, end, slabs
    )
    num_asleep = np.int64(0)
    if num_pairs >= 0:
        num_asleep = transfer_history(
            old, old_count, particles.pair_list_row, active, new, num_pairs, begin, end
        )
    return num_pairs, num_asleep, sparse, fast_outliers.size, slabs


@helper(allocates=True)
def _without(excluded, rows, count):  # type: ignore[no-untyped-def]
    """Return `rows`, all below `count`, without those that are excluded."""
    if excluded.size == 0:
        return rows
    keep = np.ones(count, np.bool_)
    keep[excluded] = False
    return rows[keep[rows]]

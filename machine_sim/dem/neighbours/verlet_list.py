"""Which particles may touch: a half Verlet list, rebuilt by counting sort when it has worn out.

A pair is listed when it is closer than the *sizes* and the *skins* of both. A particle's skin is as
far as it comes in the next steps, relative to the mean of all (a bucket that carries all of them
wears out nothing), and a little more; the list holds until one has used its skin up.

Its size is the contact radius that it grows to in these steps: particles just released are small
and lie close. One that has outgrown it wears the list out, too.

A few fast ones, crumbs that fall past a full bucket, would make the cells of all large or the list
short-lived. They are *strays*: no cell holds them, each is compared with all others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.lifecycle.growth import growth_per_step
from machine_sim.dem.neighbours.cell_grid import counting_sort_rows, rows_in_box
from machine_sim.dem.neighbours.pair_search import find_pairs
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.neighbours.pair_updates import insert_rows, mean_displacement, remove_pairs
from machine_sim.dem.neighbours.skin_widths import (
    ACCELERATION_MARGIN,
    LIST_LIFETIME_STEPS,
    any_skin_exceeded,
    compute_skin_widths,
    predict_contact_radii,
)
from machine_sim.dem.neighbours.spring_history import SpringHistory
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.partition import partition_pairs
from machine_sim.dem.state import ParticleState
from msg_bridge.kernels import use_threads

__all__ = ["VerletList"]

_MAX_SKIN_DIAMETERS = 0.35
"""Longest skin of a particle in a cell, in largest diameters, where a list holds for more than a
step."""
_MAX_BRUTE_FORCE_COMPARISONS = 1 << 18
"""Most comparisons for strays in a build: each is half a nanosecond."""
_MAX_COUNT_WITH_OUTLIERS = 1 << 13
"""Most particles among which there are strays: the list of more is cut into parts (`parts`), and
what strays touch lies in any."""


class VerletList:
    """The pair table, kept good.

    Attributes:
        pairs: the present table.
        dormant: springs of pairs that rest and are not listed.
        stale: whether rows changed, so that it must be built anew.
        builds: how often it was built.
        wear: how often among many that move, since its owner set it to 0 (few disorder little).
    """

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self.pairs = PairTable(4096, 0)
        self._spare = PairTable(4096, 0)
        self.spring_history = SpringHistory()
        self._active = np.zeros(0, np.bool_)
        self._listed_position: NDArray[np.float64] = np.zeros((0, 3))
        self._skin_widths = np.zeros(0)
        self._predicted_radii = np.zeros(0)
        self.is_stale = True
        self.num_builds = 0
        self.builds_since_sort = 0

    @property
    def threads(self) -> int:
        """How many pay in a step with this list."""
        return use_threads(self._params.threads) if self.pairs.is_partitioned else 1

    @property
    def num_listed(self) -> int:
        """How many particles are in it, the first so many rows."""
        return len(self._active)

    def remove(self, state: ParticleState, kept: NDArray[np.intp]) -> None:
        """Take out who was removed from the store.

        Args:
            store: the particles that are left.
            kept: the rows they had, ascending.
        """
        if self.is_stale or self.pairs.is_partitioned:
            self.is_stale = True
            return
        pairs, kept = self.pairs, kept[kept < self.num_listed]
        pairs.count = remove_pairs(
            kept,
            self.num_listed,
            pairs.first,
            pairs.second,
            pairs.contact_flag,
            pairs.spring,
            pairs.count,
        )
        pairs.bounds = np.array([0, pairs.count])
        self._active, self._listed_position = self._active[kept], self._listed_position[kept]
        self._skin_widths, self._predicted_radii = (
            self._skin_widths[kept],
            self._predicted_radii[kept],
        )
        state.pair_list_row[: kept.size] = np.arange(kept.size, dtype=np.int32)

    def insert(self, state: ParticleState, tracked_rows: NDArray[np.int64], dt: float) -> None:
        """List who was added to the store, behind the others; arguments as for `build`."""
        num_listed, count, pairs = self.num_listed, state.count, self.pairs
        active = _active(state)
        tracks_all = tracked_rows.size == count
        old = tracked_rows[tracked_rows < num_listed]
        way, drift = np.zeros(3), np.zeros(3)
        if tracks_all and old.size:
            way, drift = (
                mean_displacement(old, state.position, self._listed_position),
                state.velocity[old].mean(0),
            )
        speed = np.linalg.norm(state.velocity[num_listed:] - drift, axis=1)
        skin_widths = (
            self._base_skin_width(state) + ACCELERATION_MARGIN * dt * LIST_LIFETIME_STEPS * speed
        )
        self._skin_widths = np.concatenate([self._skin_widths, skin_widths])
        self._predicted_radii = np.concatenate(
            [self._predicted_radii, self._predict_radii(state, dt)[num_listed:]]
        )
        self._listed_position = np.concatenate(
            [self._listed_position, state.position[num_listed:] - way]
        )
        self._active = np.concatenate([self._active, active[num_listed:]])
        found = insert_rows(
            num_listed, active, self._listed_position, self._predicted_radii, self._skin_widths,
            pairs.first, pairs.second,
            pairs.contact_flag, pairs.spring, pairs.count,
        )  # fmt: skip
        if found < 0:
            self.build(state, tracked_rows, dt)
            return
        pairs.count = found
        pairs.bounds = np.array([0, found])
        state.pair_list_row[num_listed:] = np.arange(num_listed, count, dtype=np.int32)

    def needs_rebuild(
        self, state: ParticleState, tracked_rows: NDArray[np.int64], dt: float
    ) -> bool:
        """Whether it must be built before the next step of `dt` [s].

        Args:
            store: the particles.
            seen: rows whose motion counts: all, or those that move.
            dt: [s].
        """
        new = state.count - self.num_listed
        if self.is_stale or (
            new and (self.pairs.is_partitioned or new * state.count > _MAX_BRUTE_FORCE_COMPARISONS)
        ):
            self.is_stale = True
            return True
        old = tracked_rows[tracked_rows < self.num_listed] if new else tracked_rows
        return old.size > 0 and bool(
            any_skin_exceeded.for_threads(self.threads)(
                old, old.size == self.num_listed, state.position, state.velocity,
                self._listed_position,
                self._skin_widths, state.contact_radius, state.radius, self._predicted_radii,
                self._params.release_radius_fraction, growth_per_step(dt, self._params), dt,
            )
        )  # fmt: skip

    def _base_skin_width(self, state: ParticleState) -> float:
        """Skin of one that does not move [m]."""
        return self._params.verlet_skin * float(state.radius.mean())

    def _predict_radii(self, state: ParticleState, dt: float) -> NDArray[np.float64]:
        """Size of each in a list that is made now [m]."""
        predicted_radii = np.empty(state.count)
        predict_contact_radii(
            state.contact_radius, state.radius, self._params.release_radius_fraction,
            LIST_LIFETIME_STEPS * growth_per_step(dt, self._params), predicted_radii,
        )  # fmt: skip
        return predicted_radii

    def build(self, state: ParticleState, tracked_rows: NDArray[np.int64], dt: float) -> None:
        """List anew for steps of `dt` [s], carrying the history over.

        Args:
            store: the particles.
            seen: rows whose motion counts, one at least: all, or those that move.
            dt: [s].
        """
        active = _active(state)
        tracks_all = tracked_rows.size == state.count
        self._skin_widths, self._predicted_radii = (
            np.zeros(state.count),
            self._predict_radii(state, dt),
        )
        max_skin_width = 2.0 * _MAX_SKIN_DIAMETERS * float(state.radius.max())
        max_fast_outliers = min(_MAX_BRUTE_FORCE_COMPARISONS // state.count, tracked_rows.size // 2)
        if state.count > _MAX_COUNT_WITH_OUTLIERS:
            max_fast_outliers = 0
        largest, fast_outliers = compute_skin_widths(
            tracked_rows,
            tracks_all,
            state.velocity,
            dt,
            self._base_skin_width(state),
            max_skin_width,
            max_fast_outliers,
            self._skin_widths,
        )
        cell = 2.0 * float(self._predicted_radii.max()) + 2.0 * largest
        sparse = int(np.count_nonzero(active)) * 2 < state.count
        rows = rows_in_box(state.position, tracked_rows, cell) if sparse else np.arange(state.count)
        if fast_outliers.size:
            in_cells = np.ones(state.count, np.bool_)
            in_cells[fast_outliers] = False
            rows = rows[in_cells[rows]]
        sorting = counting_sort_rows(rows, state.position, cell)
        while not self._fill_spare(state, active, sparse, sorting, fast_outliers):
            self._spare = PairTable(2 * len(self._spare.first), 0)
        self.pairs, self._spare = self._spare, self.pairs
        self._listed_position, self._active = state.position.copy(), active
        state.pair_list_row[:] = np.arange(state.count, dtype=np.int32)
        self.num_builds += 1
        self.builds_since_sort += not sparse
        self.is_stale = False

    def _fill_spare(  # type: ignore[no-untyped-def]
        self, state: ParticleState, active, sparse, sorting, fast_outliers
    ) -> bool:
        """Fill the spare table; False where it has too little room."""
        old, new = self.pairs, self._spare
        if len(new.begin) < state.count:
            room = max(state.count, 2 * len(new.begin))
            new.begin, new.end = np.zeros(room, np.int64), np.zeros(room, np.int64)
        new.begin[: state.count] = new.end[: state.count] = 0
        slabs = np.zeros(sorting[3][1] + 1, np.int64)
        new.count, rest = find_pairs.for_threads(self.threads)(
            *sorting, fast_outliers, active, sparse,
            state.position, self._predicted_radii, self._skin_widths, state.pair_list_row,
            old.first, old.second, old.contact_flag, old.spring, old.count,
            new.first, new.second, new.contact_flag, new.spring, new.begin, new.end, slabs,
        )  # fmt: skip
        if new.count < 0:
            return False
        self.spring_history.restore(state, self._active, new)
        if rest:
            self.spring_history.save(state, old, rest)
        whole = np.array([0, new.count])
        new.bounds = whole if fast_outliers.size else partition_pairs(slabs, 2 if sparse else 1)
        return True


def _active(state: ParticleState) -> NDArray[np.bool_]:
    """Which rows move by forces, shape (n,); two that do not are no pair."""
    return np.asarray((state.sleep_state == 0) & ~state.frozen, dtype=np.bool_)

"""Verlet list: the pairs of particles that may touch within the next steps.

A pair is listed once, when its distance is less than the sum of the *predicted radii* and *skin
widths* of both. The skin width of a particle is the distance it travels in the next steps relative
to the mean of all particles, with a margin: a bucket that carries all of them does not make the
list expire. The predicted radius is the contact radius that it grows to in these steps: particles
just released are small and lie close together. The list is rebuilt, by a counting sort into cells,
when a particle may leave its skin or outgrow its predicted radius.

A few fast particles, such as crumbs that fall past a full bucket, would make the cells large or the
list short-lived. These *fast outliers* are in no cell: each is compared with all other particles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.lifecycle.growth import growth_per_step
from machine_sim.dem.neighbours.list_build import (
    ListLimits,
    active_rows,
    build_list,
)
from machine_sim.dem.neighbours.pair_search import SearchParticles
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.neighbours.pair_updates import (
    insert_rows,
    keep_listed,
    mean_displacement,
    remove_pairs,
)
from machine_sim.dem.neighbours.skin_widths import (
    ACCELERATION_MARGIN,
    LIST_LIFETIME_STEPS,
    GrowthPrediction,
    ListedParticles,
    predict_contact_radii,
)
from machine_sim.dem.neighbours.spring_history import SpringHistory
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.partition import partition_pairs
from machine_sim.dem.state import ParticleState
from msg_bridge.kernels import use_threads

__all__ = ["VerletList"]

_MAX_SKIN_DIAMETERS = 0.35
"""Maximum skin width of a particle in a cell, in maximum diameters, of a list that is valid for
more than one step."""
_MAX_BRUTE_FORCE_COMPARISONS = 1 << 18
"""Maximum number of comparisons with fast outliers or added particles; each takes half a
nanosecond."""
_MAX_COUNT_WITH_OUTLIERS = 1 << 13
"""Maximum number of particles among which there are fast outliers: longer lists are partitioned,
and a fast outlier may touch particles of any part."""


class VerletList:
    """The table of neighbouring pairs, rebuilt when it expires.

    Attributes:
        pairs: the present table.
        listed: what it assumed of its particles.
        spring_history: springs of pairs that are both asleep and not listed.
        is_stale: whether the list must be rebuilt before the next step, as rows changed.
        num_builds: number of builds.
        builds_since_sort: number of builds, since the owner set it to 0, in which most particles
            were active; those with few active particles do not disorder the rows.
    """

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self.pairs = PairTable(4096, 0)
        self._spare = PairTable(4096, 0)
        self.spring_history = SpringHistory()
        self._active = np.zeros(0, np.bool_)
        self.listed = ListedParticles.empty(0)
        self.is_stale = True
        self.num_builds = 0
        self.builds_since_sort = 0

    @property
    def threads(self) -> int:
        """Number of threads to use in a step with this list."""
        return use_threads(self._params.threads) if self.pairs.is_partitioned else 1

    @property
    def num_listed(self) -> int:
        """Number of listed particles, which are the first rows of the state."""
        return len(self._active)

    def remove(self, state: ParticleState, kept: NDArray[np.intp]) -> None:
        """Delete the pairs of particles that were removed from the state.

        Args:
            state: the particles that are left.
            kept: their previous rows, ascending.
        """
        if self.is_stale or self.pairs.is_partitioned:
            self.is_stale = True
            return
        pairs, kept = self.pairs, kept[kept < self.num_listed]
        pairs.set_pairs(remove_pairs(kept, self.num_listed, pairs.arrays, pairs.count))
        active, listed = np.empty(kept.size, np.bool_), ListedParticles.empty(kept.size)
        keep_listed(kept, self._active, self.listed, active, listed)
        self._active, self.listed = active, listed
        state.pair_list_row[: kept.size] = np.arange(kept.size, dtype=np.int32)

    def insert(self, state: ParticleState, tracked_rows: NDArray[np.int64], dt: float) -> None:
        """List the particles that were added to the state, after those listed already.

        Args:
            state: the particles.
            tracked_rows: see `build`.
            dt: length of the next steps [s].
        """
        num_listed, count, pairs = self.num_listed, state.count, self.pairs
        active = active_rows(state.sleep_state, state.frozen)
        listed_rows = tracked_rows[tracked_rows < num_listed]
        displacement, velocity = np.zeros(3), np.zeros(3)
        if tracked_rows.size == count and listed_rows.size:
            displacement = mean_displacement(listed_rows, state.position, self.listed.position)
            velocity = state.velocity[listed_rows].mean(0)
        speed = np.linalg.norm(state.velocity[num_listed:] - velocity, axis=1)
        travel = ACCELERATION_MARGIN * dt * LIST_LIFETIME_STEPS * speed
        added = ListedParticles(
            state.position[num_listed:] - displacement,
            self._base_skin_width(state) + travel,
            self._predict_radii(state, dt)[num_listed:],
        )
        self.listed = ListedParticles(
            *(np.concatenate(columns) for columns in zip(self.listed, added, strict=True))
        )
        self._active = np.concatenate([self._active, active[num_listed:]])
        listed = self.listed
        particles = SearchParticles(
            listed.position, listed.predicted_radius + listed.skin_width, active
        )
        num_pairs = insert_rows(num_listed, particles, pairs.arrays, pairs.count)
        if num_pairs < 0:
            self.build(state, tracked_rows, dt)
            return
        pairs.set_pairs(num_pairs)
        state.pair_list_row[num_listed:] = np.arange(num_listed, count, dtype=np.int32)

    def num_valid(self, count: int) -> int:
        """Return the number of listed rows, or -1 if the list must be rebuilt for `count` rows.

        Rows that are not listed are to be inserted; where they are many, a rebuild is cheaper.
        """
        num_listed = self.num_listed
        num_added = count - num_listed
        too_many = num_added and (
            self.pairs.is_partitioned or num_added * count > _MAX_BRUTE_FORCE_COMPARISONS
        )
        return -1 if self.is_stale or too_many else num_listed

    def _base_skin_width(self, state: ParticleState) -> float:
        """Return the skin width of a particle at rest [m]."""
        # `ndarray.mean` gives the same bits in three times as long.
        return self._params.verlet_skin * float(np.add.reduce(state.radius) / state.count)

    def _predict_growth(self, dt: float, num_steps: float) -> GrowthPrediction:
        """Return the bounds of the growth in some steps of `dt` [s]."""
        params = self._params
        increase = num_steps * growth_per_step(dt, params)
        return GrowthPrediction(params.release_radius_fraction, increase)

    def _predict_radii(self, state: ParticleState, dt: float) -> NDArray[np.float64]:
        """Return the predicted contact radii of a list that is made now [m], shape (n,)."""
        predicted_radius = np.empty(state.count)
        growth = self._predict_growth(dt, LIST_LIFETIME_STEPS)
        predict_contact_radii(state.contact_radius, state.radius, growth, predicted_radius)
        return predicted_radius

    def build(self, state: ParticleState, tracked_rows: NDArray[np.int64], dt: float) -> None:
        """Rebuild the list for steps of `dt` [s]; the contact history is carried over.

        Args:
            state: the particles.
            tracked_rows: rows whose motion counts, at least one: all particles, or those that move.
            dt: length of the next steps [s].
        """
        limits = ListLimits(
            self._base_skin_width(state), _MAX_SKIN_DIAMETERS,
            self._max_fast_outliers(state.count, tracked_rows.size),
        )  # fmt: skip
        growth = self._predict_growth(dt, LIST_LIFETIME_STEPS)
        while not self._fill_spare(state, tracked_rows, dt, limits, growth):
            self._spare = PairTable(2 * len(self._spare.first), 0)
        self.pairs, self._spare = self._spare, self.pairs
        state.pair_list_row[:] = np.arange(state.count, dtype=np.int32)
        self.num_builds += 1
        self.is_stale = False

    @staticmethod
    def _max_fast_outliers(count: int, num_tracked: int) -> int:
        if count > _MAX_COUNT_WITH_OUTLIERS:
            return 0
        return min(_MAX_BRUTE_FORCE_COMPARISONS // count, num_tracked // 2)

    def _fill_spare(
        self,
        state: ParticleState,
        tracked_rows: NDArray[np.int64],
        dt: float,
        limits: ListLimits,
        growth: GrowthPrediction,
    ) -> bool:
        """Fill the spare table; return False where it is too small."""
        old, new = self.pairs, self._spare
        new.clear_rows(state.count)
        active, listed = np.empty(state.count, np.bool_), ListedParticles.empty(state.count)
        num_pairs, num_asleep, sparse, num_outliers, slabs = build_list.for_threads(self.threads)(
            dt, limits, growth, tracked_rows, state.boxed, old.boxed,
            old.count, new.boxed, new.begin, new.end, active, listed,
        )  # fmt: skip
        if num_pairs < 0:
            return False
        # A sparse list has pairs that reach into the slabs on both sides.
        bounds = None if num_outliers else partition_pairs(slabs, 2 if sparse else 1)
        new.set_pairs(num_pairs, bounds)
        self.spring_history.restore(state, self._active, new)
        if num_asleep:
            self.spring_history.save(state, old, num_asleep)
        self.listed, self._active = listed, active
        self.builds_since_sort += not sparse
        return True

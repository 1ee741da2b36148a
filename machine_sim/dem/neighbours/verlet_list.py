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
from machine_sim.dem.neighbours.list_build import ListLimits, build_list
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.neighbours.pair_updates import insert_rows, remove_rows
from machine_sim.dem.neighbours.skin_widths import (
    LIST_LIFETIME_STEPS,
    GrowthPrediction,
    ListedParticles,
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
        self.pairs = PairTable(4096)
        self._spare = PairTable(4096)
        self.spring_history = SpringHistory()
        self._active = np.zeros(0, np.bool_)
        self.listed = ListedParticles.empty(0)
        self._row_numbers = np.zeros(0, np.int32)
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
        pairs, listed = self.pairs, self.listed
        num_pairs, count = remove_rows(
            kept, pairs.boxed, pairs.count, listed, self._active, state.boxed
        )
        pairs.set_pairs(num_pairs)
        self.listed = ListedParticles(*(column[:count] for column in listed))
        self._active = self._active[:count]

    def insert(self, state: ParticleState, tracked_rows: NDArray[np.int64], dt: float) -> None:
        """List the particles that were added to the state, after those listed already.

        Args:
            state: the particles.
            tracked_rows: see `build`.
            dt: length of the next steps [s].
        """
        pairs, old, old_active = self.pairs, self.listed, self._active
        self.listed = ListedParticles.empty(state.count)
        self._active = np.empty(state.count, np.bool_)
        num_pairs = insert_rows(
            dt, self._base_skin_width(state), self._predict_growth(dt, LIST_LIFETIME_STEPS),
            tracked_rows, state.boxed, pairs.boxed, pairs.count, old, old_active, self.listed,
            self._active,
        )  # fmt: skip
        if num_pairs < 0:
            self.build(state, tracked_rows, dt)
            return
        pairs.set_pairs(num_pairs)

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
            self._spare = PairTable(2 * len(self._spare.first))
        self.pairs, self._spare = self._spare, self.pairs
        if len(self._row_numbers) < state.count:
            self._row_numbers = np.arange(2 * state.count, dtype=np.int32)
        state.pair_list_row[:] = self._row_numbers[: state.count]
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
        active, listed = np.empty(state.count, np.bool_), ListedParticles.empty(state.count)
        num_pairs, num_asleep, sparse, num_outliers, slabs = build_list.for_threads(self.threads)(
            dt, limits, growth, tracked_rows, state.boxed, old.boxed,
            old.count, new.boxed, active, listed,
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

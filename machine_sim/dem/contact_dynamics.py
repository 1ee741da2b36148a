"""Contact dynamics of particles: the data kept for contacts, and the stages that use it.

The stages of a step are the neighbour list, the ground contacts, growth and the substeps. What is
kept from step to step is rebuilt as `invalidation` describes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.body_records import load_body_records, store_body_records
from machine_sim.dem.contacts.contact_law import ContactParameters
from machine_sim.dem.contacts.ground_contacts import (
    GroundContactList,
    GroundContacts,
    GroundParticles,
)
from machine_sim.dem.contacts.ground_recovery import recover_and_time_settling
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks, PairContacts
from machine_sim.dem.contacts.plate_contact_list import PlateContactList
from machine_sim.dem.contacts.plate_contacts import PlateContacts
from machine_sim.dem.invalidation import (
    BODY_RECORDS,
    CONTACT_BLOCKS,
    INITIAL_RADII,
    NEIGHBOUR_LIST,
    Change,
    Invalidation,
)
from machine_sim.dem.lifecycle.growth import (
    GrowthView,
    grow_radii,
    growth_per_step,
    set_initial_radii,
)
from machine_sim.dem.neighbours.cell_grid import spatial_order
from machine_sim.dem.neighbours.verlet_list import VerletList
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ParticleState
from machine_sim.dem.step_buffers import StepBuffers
from machine_sim.dem.substeps import LockedRows, SubstepParams, run_substeps
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground

__all__ = ["ContactDynamics", "MovingRows"]

_BUILDS_PER_SORT = 50
"""List builds with many moving particles between two spatial sorts of the rows."""
_TRACK_ALL_FRACTION = 0.75
"""Fraction of moving particles above which the neighbour list tracks the motion of all."""


class MovingRows(NamedTuple):
    """Rows that move in a step.

    Attributes:
        free: rows that move by forces.
        locked: rows that are locked to a tool.
        locked_tool: tool index of each locked row.
        all: free rows, then locked ones.
    """

    free: NDArray[np.int64]
    locked: NDArray[np.int64]
    locked_tool: NDArray[np.int64]
    all: NDArray[np.int64]


class ContactDynamics:
    """Neighbour list, contacts and body records of an engine's particles.

    Attributes:
        neighbour_list: list of the pairs that may touch.
        plate_list: list of the particles near plates.
    """

    def __init__(
        self, params: ParticleParams, state: ParticleState, ground: Ground, tools: ToolSet
    ) -> None:
        self.neighbour_list = VerletList(params)
        self.plate_list = PlateContactList()
        self._params = params
        self._state = state
        self._ground = ground
        self._tools = tools
        self._pair_contacts = PairContacts()
        self._plate_contacts = PlateContacts()
        self._ground_list = GroundContactList()
        self._substep_params = SubstepParams(
            num_substeps=params.substeps,
            gravity=np.float32(params.gravity),
            ground_friction=np.float32(params.ground_friction),
            ground_rolling_friction=np.float32(params.ground_rolling_friction),
        )
        self._buffers = StepBuffers()
        self._invalidation = Invalidation()
        self._num_growing = 0

    @property
    def pair_contacts(self) -> PairContactBlocks:
        """Contacts of pairs in the last step."""
        return self._pair_contacts.blocks

    # Changes.

    def invalidate(self, change: Change) -> None:
        """Make derived data stale; springs return from contact blocks to the pair list first."""
        if not self._invalidation.is_stale(CONTACT_BLOCKS):
            self.store_springs()
        self._invalidation.record(change)
        self.neighbour_list.is_stale |= self._invalidation.is_stale(NEIGHBOUR_LIST)

    def store_springs(self) -> None:
        """Copy the springs of the contact blocks to the table of the neighbour list."""
        pairs = self.neighbour_list
        self._pair_contacts.store_history(pairs.pairs, pairs.threads)

    def include_added(self, count: int, *, grow: bool) -> None:
        """Take over particles that were added to the state."""
        self.invalidate(Change.GROWING_ADDED if grow else Change.PARTICLES_ADDED)
        self._num_growing += count if grow else 0

    def remove_rows(self, rows: NDArray[np.intp]) -> None:
        """Remove particles from the state and from the neighbour list."""
        self.invalidate(Change.PARTICLES_REMOVED)
        self.neighbour_list.remove(self._state, self._state.remove(rows))

    def sort_rows(self) -> None:
        """Sort the rows so that neighbours in space are neighbours in memory."""
        if self._state.count:
            self._state.reorder(spatial_order(self._state))
            self.invalidate(Change.ROWS_REORDERED)
        self.neighbour_list.builds_since_sort = 0

    # Stages of a step.

    def prepare_rows(self) -> None:
        """Make room for the records of all rows, and sort the rows once in a while."""
        # Tools have body records too, in the last rows.
        if self._buffers.reserve(self._state.count + len(self._tools.tools)):
            self.invalidate(Change.BUFFERS_REALLOCATED)
        if self.neighbour_list.builds_since_sort >= _BUILDS_PER_SORT:
            self.sort_rows()

    def update_neighbour_list(self, dt: float, moving: MovingRows) -> None:
        """Rebuild the neighbour list where it is worn out, or insert the particles added since."""
        state, pairs = self._state, self.neighbour_list
        # The list measures displacements from the mean of the tracked rows. Where most particles
        # rest, only the moving ones are tracked.
        tracks_all = moving.all.size > _TRACK_ALL_FRACTION * state.count
        tracked_rows = np.arange(state.count) if tracks_all else moving.all
        if pairs.needs_rebuild(state, tracked_rows, dt):
            self.invalidate(Change.LIST_EXPIRED)
            pairs.build(state, tracked_rows, dt)
            self._invalidation.mark_rebuilt(NEIGHBOUR_LIST)
        elif pairs.num_listed < state.count:
            pairs.insert(state, tracked_rows, dt)

    def list_ground_contacts(
        self,
        dt: float,
        contact_params: ContactParameters,
        rows: NDArray[np.int64],
        ground_masked: NDArray[np.bool_],
        near: NDArray[np.bool_],
    ) -> GroundContacts:
        """List the ground contacts of a step; see `GroundContactList.update`."""
        return self._ground_list.update(
            self._state, self._ground, rows, ground_masked, near, contact_params, dt,
            self.neighbour_list.threads,
        )  # fmt: skip

    def grow(self, dt: float, ground_contacts: GroundContacts) -> bool:
        """Set the contact radii of released particles, and grow those below the full radius.

        Returns:
            Whether contact radii may have changed.
        """
        if self._num_growing == 0:
            return False
        params, pairs, view = self._params, self.neighbour_list.pairs, self._state.view(GrowthView)
        first, second = pairs.first[: pairs.count], pairs.second[: pairs.count]
        if self._invalidation.is_stale(INITIAL_RADII):
            set_initial_radii(
                params.release_radius_fraction, first, second, view,
                self.plate_list.table.candidates, self._tools.motion, ground_contacts,
            )  # fmt: skip
            self._invalidation.mark_rebuilt(INITIAL_RADII)
        self._num_growing = grow_radii(growth_per_step(dt, params), first, second, view)
        return True

    def integrate(
        self,
        dt: float,
        contact_params: tuple[ContactParameters, ContactParameters],
        moving: MovingRows,
        ground_contacts: GroundContacts,
        radii_changed: bool,
    ) -> None:
        """Run the substeps, from body records that are loaded before and stored after them.

        Args:
            dt: [s].
            contact_params: contact law of pairs, and of plates and the ground.
            moving: rows that move.
            ground_contacts: ground contacts of the step.
            radii_changed: whether contact radii have changed since the last step.
        """
        state, tools = self._state, self._tools
        body, force_sums = self._buffers.body_records, self._buffers.force_sums
        threads = self.neighbour_list.threads
        all_stale = self._invalidation.is_stale(BODY_RECORDS)
        load_body_records.for_threads(threads)(
            np.arange(state.count) if all_stale else moving.all, body, force_sums, state.velocity,
            state.angular_velocity, state.contact_radius, state.radius, state.inverse_mass,
            state.sleep_state,
        )  # fmt: skip
        self._pair_contacts.update(
            state, body, self.neighbour_list.pairs, dt, threads,
            rebuild=self._invalidation.is_stale(CONTACT_BLOCKS),
            radii_changed=radii_changed,
        )  # fmt: skip
        self._invalidation.mark_rebuilt(BODY_RECORDS, CONTACT_BLOCKS)
        plate_contacts = self._plate_contacts.fill_blocks(
            state, self.plate_list.table, tools, body, force_sums
        )
        run_substeps.for_threads(threads)(
            self._substep_params, *contact_params, moving.free,
            LockedRows(moving.locked, moving.locked_tool), body, force_sums,
            state.view(GroundParticles), self.pair_contacts, plate_contacts, ground_contacts,
            tools.motion,
        )  # fmt: skip
        self._plate_contacts.store_history(self.plate_list.table)
        store_body_records.for_threads(threads)(
            moving.free, body, state.position, state.velocity, state.angular_velocity
        )

    def finish_ground_contacts(
        self, dt: float, rows: NDArray[np.int64], ground_contacts: GroundContacts
    ) -> int:
        """Put sunken particles back on the ground, and advance the settle timers.

        Returns:
            Number of particles that were put back.
        """
        return recover_and_time_settling(
            self._state, self._ground, rows, ground_contacts, self._params.settle_speed, dt,
            self.neighbour_list.threads,
        )  # fmt: skip

"""Contact dynamics of particles: the data kept for contacts, and the stages that use it.

The stages of a step are the neighbour list, the ground contacts, growth and the substeps. What is
kept from step to step is rebuilt as `invalidation` describes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts.boundary_contacts import list_boundary_contacts
from machine_sim.dem.contacts.contact_law import contact_parameters
from machine_sim.dem.contacts.ground_contacts import GroundContactList
from machine_sim.dem.contacts.pair_contacts import PairContacts
from machine_sim.dem.contacts.plate_contact_list import PlateContactList
from machine_sim.dem.contacts.plate_contacts import PlateContacts
from machine_sim.dem.contacts.step_contacts import BoundaryContacts, StepContactTables
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
from machine_sim.dem.sleep.sleep_state import MovingRows
from machine_sim.dem.state import ParticleState
from machine_sim.dem.step_buffers import StepBuffers
from machine_sim.dem.step_motion import (
    MotionParams,
    StepState,
    move_particles,
)
from machine_sim.dem.step_particles import StepParticles
from machine_sim.dem.substeps import SubstepParams
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["ContactDynamics"]

_BUILDS_PER_SORT = 50
"""List builds with many moving particles between two spatial sorts of the rows."""
_TRACK_ALL_FRACTION = 0.75
"""Fraction of moving particles above which the neighbour list tracks the motion of all."""


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
        self._tools = tools
        self._pair_contacts = PairContacts()
        self._plate_contacts = PlateContacts()
        self._ground_list = GroundContactList(ground)
        self._boxed_params: dict[float, BoxedTable] = {}  # of the last length of a step
        self._buffers = StepBuffers()
        self._invalidation = Invalidation()
        self._num_growing = 0

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

    def list_boundary_contacts(self, dt: float, rows: NDArray[np.int64]) -> BoundaryContacts:
        """List the plates and the ground that `rows` may touch in a step of `dt` [s].

        Args:
            dt: length of the step [s].
            rows: rows that move by forces.
        """
        state, tools, plate_list = self._state, self._tools, self.plate_list
        self._ground_list.reserve(rows.size)
        while True:
            inside, num_plate_contacts, num_ground_contacts = list_boundary_contacts.for_threads(
                self.neighbour_list.threads
            )(
                dt, self._motion_params(dt), rows, state.boxed_view(StepParticles),
                tools.boxed_motion, self._ground_list.boxed_data, plate_list.table.boxed_arrays,
                plate_list.next_table(state.count).boxed_arrays,
            )  # fmt: skip
            if not tools.tools:
                plate_list.table.count = 0
                break
            if plate_list.accept(num_plate_contacts):
                break
        return BoundaryContacts(inside, plate_list.table.count, num_ground_contacts)

    def contact_tables(self, contacts: BoundaryContacts) -> StepContactTables:
        """Return all contacts of the step, with the `contacts` of it that were listed."""
        return StepContactTables(
            self._pair_contacts.boxed,
            self.plate_list.table.boxed_arrays, contacts.num_plate_contacts,
            self._ground_list.boxed_data, contacts.num_ground_contacts,
        )  # fmt: skip

    def _motion_params(self, dt: float) -> BoxedTable:
        """Return the boxed `MotionParams` of steps of `dt` [s]."""
        boxed = self._boxed_params.get(dt)
        if boxed is None:
            params = self._params
            substep, duration = dt / params.substeps, params.substeps_per_contact
            substeps = SubstepParams(
                num_substeps=params.substeps,
                gravity=np.float32(params.gravity),
                ground_friction=np.float32(params.ground_friction),
                ground_rolling_friction=np.float32(params.ground_rolling_friction),
            )
            self._boxed_params.clear()
            boxed = self._boxed_params[dt] = box_table(
                MotionParams(
                    substeps,
                    contact_parameters(substep, duration, params.restitution),
                    contact_parameters(substep, duration, params.boundary_restitution),
                    params.settle_speed,
                )
            )
        return boxed

    def grow(self, dt: float, num_ground_contacts: int) -> bool:
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
                self.plate_list.table.candidates, self._tools.motion,
                self._ground_list.first(num_ground_contacts),
            )  # fmt: skip
            self._invalidation.mark_rebuilt(INITIAL_RADII)
        self._num_growing = grow_radii(growth_per_step(dt, params), first, second, view)
        return True

    def move(
        self, dt: float, moving: MovingRows, num_ground_contacts: int, radii_changed: bool
    ) -> tuple[int, int]:
        """Move the particles that move by forces, and advance their settle timers.

        Args:
            dt: [s].
            moving: rows that move.
            num_ground_contacts: number of listed contacts with the ground.
            radii_changed: whether contact radii have changed since the last step.

        Returns:
            (number of particles that passed through a plate, number of particles that had sunk
            through the ground and were put back).
        """
        tools, pairs, plates = self._tools, self.neighbour_list.pairs, self.plate_list.table
        loads_all = self._invalidation.is_stale(BODY_RECORDS)
        rebuilds_contacts = self._invalidation.is_stale(CONTACT_BLOCKS)
        if rebuilds_contacts:
            self._pair_contacts.clear(pairs)
        self._plate_contacts.reserve(plates, len(tools.tool_of_plate))
        num_tunnelled, num_recovered = move_particles.for_threads(self.neighbour_list.threads)(
            dt, self._motion_params(dt),
            StepState(
                loads_all, rebuilds_contacts, radii_changed, plates.count, num_ground_contacts
            ),
            moving, self._buffers.body_records, self._buffers.force_sums,
            self._state.boxed_view(StepParticles), pairs.boxed, self._pair_contacts.boxed,
            plates.boxed_arrays, self._plate_contacts.boxed_memory, self._ground_list.boxed_data,
            tools.boxed_motion,
        )  # fmt: skip
        self._invalidation.mark_rebuilt(BODY_RECORDS, CONTACT_BLOCKS)
        return num_tunnelled, num_recovered

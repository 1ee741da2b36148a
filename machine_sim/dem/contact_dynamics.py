"""Contact dynamics of particles: the data kept for contacts, and the stages that use it.

The stages of a step are the neighbour list, and the motion with contacts and growth. What is kept
from step to step is rebuilt as `invalidation` describes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from machine_sim.dem.lifecycle.growth import growth_per_step
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
from machine_sim.dem.substeps import SubstepParams
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["ContactDynamics", "StepMotion"]

_BUILDS_PER_SORT = 50
"""List builds with many moving particles between two spatial sorts of the rows."""
_TRACK_ALL_FRACTION = 0.75
"""Fraction of moving particles above which the neighbour list tracks the motion of all."""


class StepMotion(NamedTuple):
    """Result of a step in which particles moved.

    Attributes:
        contacts: contacts with plates and the ground.
        num_tunnelled: number of particles that passed through a plate.
        num_recovered: number of particles that had sunk through the ground and were put back.
    """

    contacts: BoundaryContacts
    num_tunnelled: int
    num_recovered: int


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

    def contact_tables(self, contacts: BoundaryContacts) -> StepContactTables:
        """Return all contacts of the step, with the `contacts` of it that were listed."""
        return StepContactTables(
            self._buffers.boxed_memory, self._pair_contacts.boxed,
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
                    params.release_radius_fraction,
                    growth_per_step(dt, params),
                )
            )
        return boxed

    def move(self, dt: float, moving: MovingRows) -> StepMotion:
        """List the contacts with plates and the ground, let particles grow, and move them.

        Args:
            dt: [s].
            moving: rows that move; at least one moves by forces.
        """
        tools, pairs, plate_list = self._tools, self.neighbour_list.pairs, self.plate_list
        invalidation, has_tools = self._invalidation, bool(tools.tools)
        self._ground_list.reserve(moving.num_free)
        step = StepState(
            loads_all=invalidation.is_stale(BODY_RECORDS),
            rebuilds_contacts=invalidation.is_stale(CONTACT_BLOCKS),
            grows=self._num_growing > 0,
            sets_initial_radii=invalidation.is_stale(INITIAL_RADII),
        )
        if step.rebuilds_contacts:
            self._pair_contacts.clear(pairs)
        is_moved = False
        while not is_moved:
            plates = plate_list.next_table(self._state.count)
            self._plate_contacts.reserve(plates, len(tools.tool_of_plate))
            num_plate_contacts, num_ground_contacts, num_growing, num_tunnelled, num_recovered = (
                move_particles.for_threads(self.neighbour_list.threads)(
                    dt, self._motion_params(dt), step, moving, self._buffers.boxed_memory,
                    self._state.boxed, pairs.boxed, self._pair_contacts.boxed,
                    plate_list.table.boxed_arrays, plates.boxed_arrays,
                    self._plate_contacts.boxed_memory, self._ground_list.boxed_data,
                    tools.boxed_motion,
                )
            )  # fmt: skip
            is_moved = plate_list.accept(num_plate_contacts, has_tools=has_tools)
        if step.grows:
            self._num_growing = num_growing
            invalidation.mark_rebuilt(INITIAL_RADII)
        invalidation.mark_rebuilt(BODY_RECORDS, CONTACT_BLOCKS)
        contacts = BoundaryContacts(num_plate_contacts, num_ground_contacts)
        return StepMotion(contacts, num_tunnelled, num_recovered)

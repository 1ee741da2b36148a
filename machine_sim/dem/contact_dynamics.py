"""Contact dynamics of particles: the data kept for contacts, and the stages that use it.

What is kept from step to step is rebuilt as `invalidation` describes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts.contact_law import contact_parameters
from machine_sim.dem.contacts.ground_contacts import GroundContactList
from machine_sim.dem.contacts.pair_contacts import PairContacts
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
from machine_sim.dem.lifecycle.growth import growth_per_step
from machine_sim.dem.neighbours.cell_grid import spatial_order
from machine_sim.dem.neighbours.skin_widths import tracks_all_rows
from machine_sim.dem.neighbours.verlet_list import VerletList
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.particle_step import StepResult, StepState, advance_particles
from machine_sim.dem.sleep.sleep_manager import SleepManager
from machine_sim.dem.sleep.sleep_state import SleepParams
from machine_sim.dem.state import ParticleState
from machine_sim.dem.step_buffers import StepBuffers
from machine_sim.dem.step_motion import StepParams
from machine_sim.dem.step_start import LIST_EXPIRED, READY, ROWS_NOT_LISTED
from machine_sim.dem.substeps import SubstepParams
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["ContactDynamics"]

_BUILDS_PER_SORT = 50
"""List builds with many moving particles between two spatial sorts of the rows."""


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
        self._ground = ground
        self._ground_list = GroundContactList(ground)
        self._boxed_params: dict[float, BoxedTable] = {}  # of the last length of a step
        self._buffers = StepBuffers()
        self._invalidation = Invalidation()
        self._contacts_cleared = False
        self._num_growing = 0

    # Changes.

    def invalidate(self, change: Change) -> None:
        """Make derived data stale; springs return from contact blocks to the pair list first."""
        if CONTACT_BLOCKS not in self._invalidation.stale:
            self.store_springs()
        self._invalidation.record(change)
        self._contacts_cleared = False
        self.neighbour_list.is_stale |= NEIGHBOUR_LIST in self._invalidation.stale

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

    # A step.

    def advance(self, dt: float, sleep: SleepManager) -> StepResult:
        """Advance all particles by one step of `dt` [s]."""
        self._prepare_rows()
        spheres, ground = sleep.pop_wake_spheres(), self._ground
        state = self._step_state(
            self.neighbour_list.num_valid(self._state.count), ground_changed=ground.has_changes
        )
        ground.has_changes = False
        result = self._run(dt, state, spheres, sleep)
        if result.num_disturbed:
            self.invalidate(Change.PARTICLES_WOKEN)
        if result.todo != READY:
            self._update_list(dt, result)
        while result.todo != READY or result.num_plate_contacts < 0:
            if result.num_plate_contacts < 0:
                self.plate_list.enlarge()
            self._make_room(result.num_free)
            state = self._step_state(self.neighbour_list.num_listed, started=result)
            result = self._run(dt, state, spheres, sleep)
        if result.num_free:
            self._accept(result, sleep)
        return result

    def _prepare_rows(self) -> None:
        """Make room for the records of all rows, and sort the rows once in a while."""
        # Tools have body records too, in the last rows.
        if self._buffers.reserve(self._state.count + len(self._tools.tools)):
            self.invalidate(Change.BUFFERS_REALLOCATED)
        if self.neighbour_list.builds_since_sort >= _BUILDS_PER_SORT:
            self.sort_rows()

    def _step_state(
        self,
        num_listed: int,
        *,
        ground_changed: bool = False,
        started: StepResult | None = None,
    ) -> StepState:
        """Return what has changed since the last step, and the numbers of a step that has started.

        Pair contacts that are stale are cleared where the neighbour list is valid: once, as they
        remain stale while no particle moves.
        """
        stale = self._invalidation.stale
        rebuilds_contacts = CONTACT_BLOCKS in stale
        if rebuilds_contacts and NEIGHBOUR_LIST not in stale and not self._contacts_cleared:
            self._pair_contacts.clear(self.neighbour_list.pairs)
            self._contacts_cleared = True
        return StepState(
            started is not None,
            started.num_free if started else 0,
            started.num_locked if started else 0,
            num_listed,
            ground_changed,
            BODY_RECORDS in stale,
            rebuilds_contacts,
            self._num_growing > 0,
            INITIAL_RADII in stale,
        )

    def _run(
        self, dt: float, state: StepState, spheres: NDArray[np.float64], sleep: SleepManager
    ) -> StepResult:
        """Call the kernel of a step."""
        pairs, plates, tools = self.neighbour_list, self.plate_list, self._tools
        return StepResult(
            *advance_particles.for_threads(pairs.threads)(
                dt, state, spheres, pairs.listed, self._step_params(dt),
                self._buffers.boxed_memory, self._state.boxed, pairs.pairs.boxed,
                self._pair_contacts.boxed, plates.table.boxed_arrays, plates.next.boxed_arrays,
                self._plate_contacts.boxed_memory, self._ground_list.boxed_data,
                tools.boxed_motion, sleep.boxed_gravity,
            )
        )  # fmt: skip

    def _update_list(self, dt: float, started: StepResult) -> None:
        """Rebuild the neighbour list where it is worn out, or insert the particles added since."""
        state, pairs = self._state, self.neighbour_list
        num_moving = started.num_free + started.num_locked
        memory = self._buffers.memory
        if tracks_all_rows(num_moving, state.count):
            tracked_rows = memory.all_rows[: state.count]
        else:
            tracked_rows = memory.moving_rows[:num_moving]
        if started.todo == LIST_EXPIRED:
            self.invalidate(Change.LIST_EXPIRED)
            pairs.build(state, tracked_rows, dt)
            self._invalidation.mark_rebuilt(NEIGHBOUR_LIST)
        elif started.todo == ROWS_NOT_LISTED:
            pairs.insert(state, tracked_rows, dt)
        self._contacts_cleared = False

    def _make_room(self, num_free: int) -> None:
        """Make room for the contacts of a number of particles that move by forces."""
        self._ground_list.reserve(num_free)
        table = self.plate_list.next_table(self._state.count)
        self._plate_contacts.reserve(table, len(self._tools.tool_of_plate))

    def _accept(self, result: StepResult, sleep: SleepManager) -> None:
        """Take over the results of a step in which particles moved by forces."""
        self.plate_list.accept(result.num_plate_contacts, has_tools=bool(self._tools.tools))
        self._num_growing = result.num_growing
        if self._invalidation.stale:
            self._invalidation.mark_rebuilt(INITIAL_RADII, BODY_RECORDS, CONTACT_BLOCKS)
        if result.num_locking:
            rows = self._buffers.memory.moving_rows[: result.num_free]
            sleep.set_locked_positions(self._state, self._tools, rows)
        if result.num_woken:
            self.invalidate(Change.PARTICLES_WOKEN)
        if result.num_asleep:
            self.invalidate(Change.PARTICLES_ASLEEP)

    def _step_params(self, dt: float) -> BoxedTable:
        """Return the boxed `StepParams` of steps of `dt` [s]."""
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
                StepParams(
                    SleepParams.of(params),
                    substeps,
                    contact_parameters(substep, duration, params.restitution),
                    contact_parameters(substep, duration, params.boundary_restitution),
                    params.settle_speed,
                    params.release_radius_fraction,
                    growth_per_step(dt, params),
                )
            )
        return boxed

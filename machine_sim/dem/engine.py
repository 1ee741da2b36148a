"""The particle engine: soil released by tools, moved by contacts, until it lands.

One step reads top to bottom: near pairs, ground planes and plates are listed, released particles
start and grow, substeps move all, and who got through a plate or the ground is counted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.contacts.contact_law import ContactParameters, contact_law
from machine_sim.dem.contacts.ground_contacts import (
    GroundContacts,
    finish_ground_contacts,
    list_ground_contacts,
)
from machine_sim.dem.contacts.pair_contacts import PairContacts
from machine_sim.dem.contacts.pair_forces import max_pair_overlap
from machine_sim.dem.contacts.plate_contact_list import PlateContactList
from machine_sim.dem.contacts.plate_contacts import PlateContacts
from machine_sim.dem.contacts.tunnelling import count_tunnelled
from machine_sim.dem.integrate import (
    BODY_RECORD_SIZE,
    FORCE_RECORD_SIZE,
    load_body_records,
    store_body_records,
)
from machine_sim.dem.lifecycle.growth import grow_radii, growth_per_step, set_initial_radii
from machine_sim.dem.lifecycle.release_validation import validate_release
from machine_sim.dem.neighbours.cell_grid import spatial_order
from machine_sim.dem.neighbours.verlet_list import VerletList
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.sleep.sleep_manager import SleepManager, StepContacts, select_moving_rows
from machine_sim.dem.sleep.wake_conditions import wake_touching
from machine_sim.dem.soil_engine import SoilEngine
from machine_sim.dem.state import ParticleError
from machine_sim.dem.substeps import run_substeps
from machine_sim.dem.tools.pose import Pose
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["ParticleEngine"]

_BUILDS_PER_SORT = 50
"""Builds of the neighbour list among many between two sortings of the rows by place."""
_TRACK_ALL_FRACTION = 0.75
"""Part of all that moves where the others are reckoned with as if they moved, too."""


class ParticleEngine(SoilEngine):
    """Soil as spheres; `step` may reorder the rows of the store."""

    def __init__(
        self,
        params: ParticleParams,
        ground: Ground,
        *,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
    ) -> None:
        """An engine without particles.

        Args:
            soils: all soils of the terrain, in the order of their ids.

        Raises:
            ParticleError: no soil.
        """
        super().__init__(params, ground, soils, params.substeps)
        self._pairs = VerletList(params)
        self._plate_list = PlateContactList()
        self._plate_contacts = PlateContacts()
        self._pair_contacts = PairContacts()
        self._body_records = np.zeros((0, BODY_RECORD_SIZE), np.float32)
        self._force_sums = np.zeros((0, FORCE_RECORD_SIZE), np.float32)
        self._ground_row = np.zeros(0, np.int64)
        self._plane = np.zeros((0, 4))
        self._sleep_manager = SleepManager(params)
        self._num_growing = 0
        self._has_unsized_particles = False
        self._records_stale = True
        self._rebuild_contacts = True

    # Particles in and out.

    def add(
        self,
        position: ArrayLike,
        velocity: ArrayLike,
        volume_mm3: ArrayLike,
        soil: ArrayLike = 0,
        moisture: ArrayLike = 0,
        *,
        grow: bool = True,
    ) -> NDArray[np.uint32]:
        """Release soil as particles; see `SoilEngine.add`."""
        new = validate_release(position, velocity, volume_mm3, soil, moisture)
        n, soils = len(new.position), new.soil.astype(np.int64)
        if n == 0:
            return np.zeros(0, dtype=np.uint32)
        self._materials.validate_soil_ids(soils)
        kind = (soils, np.minimum(new.moisture, 100))
        materials = self._materials
        bank = new.volume_mm3 * 1e-9
        radius = materials.radius(bank, *kind)
        mass = bank * materials.density[soils]
        ids = self.state.add(
            n,
            position=new.position,
            wake_reference=new.position,
            velocity=new.velocity,
            radius=radius,
            contact_radius=0.0 if grow else radius,
            mass=mass,
            inverse_mass=1.0 / mass,
            volume_mm3=new.volume_mm3,
            soil=new.soil,
            moisture=new.moisture,
            friction=materials.friction[kind],
            rolling_friction=materials.rolling_friction[kind],
            cohesion=materials.cohesion[kind],
            tool_friction=materials.tool_friction[kind],
            tool_rolling_friction=materials.tool_rolling_friction[kind],
            adhesion=materials.adhesion[kind],
        )
        self._wake_near_rows(self.state.rows(ids))
        self._num_growing += n if grow else 0
        self._has_unsized_particles |= grow
        return ids

    def remove(self, ids: ArrayLike) -> None:
        """See `SoilEngine.remove`."""
        rows = self.state.rows(ids)
        if rows.size:
            self._wake_near_rows(rows)
            self._invalidate_contacts()
            self._pairs.remove(self.state, self.state.remove(rows))
            self._records_stale = True

    def _wake_near_rows(self, rows: NDArray[np.intp]) -> None:
        """Wake what touches some particles that will not be there as before."""
        state = self.state
        reach = 1.1 * state.radius[rows].astype(np.float64)
        self._sleep_manager.request_wake(np.column_stack([state.position[rows], reach]))

    def freeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.freeze`."""
        rows = self.state.rows(ids)
        self._sleep_manager.wake_rows(self.state, rows)
        self._records_stale = True
        self.state.frozen[rows] = True
        self.state.inverse_mass[rows] = 0.0
        self.state.velocity[rows] = 0.0
        self.state.angular_velocity[rows] = 0.0

    def unfreeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.unfreeze`."""
        rows = self.state.rows(ids)
        if rows.size == 0:
            return
        self._wake_near_rows(rows)
        self._pairs.is_stale = True
        self.state.frozen[rows] = False
        self.state.inverse_mass[rows] = 1.0 / self.state.mass[rows]
        self.state.settle_timer[rows] = 0.0

    # Tools.

    def add_tool(
        self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose, *, is_digging: bool = True
    ) -> None:
        """See `SoilEngine.add_tool`."""
        tool = RigidTool(plates, pose, is_digging=is_digging)
        self._tools.add(tool_id, tool)
        self._sleep_manager.add_tool(tool)
        # It may stand where soil lies that sleeps.
        self._sleep_manager.request_wake(
            np.array([[*(tool.start[1] + tool.start[0] @ tool.centre), tool.bounding_radius]])
        )

    def remove_tool(self, tool_id: int) -> None:
        """See `SoilEngine.remove_tool`."""
        first = self._tools.first
        number = self._tools.remove(tool_id)
        self._sleep_manager.remove_tool(number)
        self._plate_list.remove(int(first[number]), int(first[number + 1]))
        # What rested in it or against it is roused: all, since a tool goes away once in a while.
        rows = np.flatnonzero(self.state.sleep_state)
        self._sleep_manager.wake_rows(self.state, rows)
        self._pairs.is_stale = True

    def close(self) -> None:
        """See `SoilEngine.close`; there is nothing to free."""

    # Time.

    def step(self, dt: float) -> None:
        """Advance all particles by `dt` [s], in `params.substeps` substeps.

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """
        self._check_step(dt)
        state, params, ground, tools = self.state, self.params, self.ground, self._tools
        tools.begin_step(dt)
        self._reserve_records()
        if self._pairs.builds_since_sort >= _BUILDS_PER_SORT and state.count:
            state.reorder(spatial_order(state))
            self._pairs.is_stale = self._records_stale = True
            self._pairs.builds_since_sort = 0
        if self._sleep_manager.wake_disturbed(state, tools, ground, dt).size:
            self._pairs.is_stale = True
        rows, locked_rows, locked_tool = select_moving_rows(state.sleep_state, state.frozen)
        if rows.size == 0:
            if locked_rows.size:
                self._sleep_manager.move_locked_loads(state, tools, locked_rows, locked_tool)
            tools.end_step()
            return
        moving = np.concatenate([rows, locked_rows]) if locked_rows.size else rows
        # Ways are seen from the mean of all, but where many rest: those are then not looked at.
        tracked_rows = (
            np.arange(state.count) if moving.size > _TRACK_ALL_FRACTION * state.count else moving
        )
        if self._pairs.needs_rebuild(state, tracked_rows, dt):
            self._invalidate_contacts()
            self._pairs.build(state, tracked_rows, dt)
        elif self._pairs.num_listed < state.count:
            self._invalidate_contacts()
            self._pairs.insert(state, tracked_rows, dt)
        substep = dt / params.substeps
        pair_and_boundary_params = (
            contact_law(substep, params.substeps_per_contact, params.restitution),
            contact_law(substep, params.substeps_per_contact, params.boundary_restitution),
        )
        tool_frame_positions = tools.tool_frame_positions(rows, state.position)
        inside, ground_masked, near = tools.classify_near_tools(
            tool_frame_positions, ground.grid.cell
        )
        threads = self._pairs.threads
        count = list_ground_contacts.for_threads(threads)(
            ground.surface, ground.frame, dt, pair_and_boundary_params[1], rows, ground_masked, near, state.position,
            state.velocity, state.radius, state.contact_radius, state.penetration_limited, state.ground_spring,
            self._ground_row, self._plane,
        )  # fmt: skip
        ground_contacts = GroundContacts(self._ground_row[:count], self._plane[:count])
        self._plate_list.update(state, rows, tools, tool_frame_positions, dt)
        if self._records_stale:
            self._invalidate_contacts()
        grows = self._num_growing > 0
        if grows:
            self._grow(dt, ground_contacts)
        before = state.position.take(rows, axis=0) if tools.tools else state.position[:0]
        self._integrate(
            dt,
            pair_and_boundary_params,
            rows,
            moving,
            locked_rows,
            locked_tool,
            ground_contacts,
            grows,
        )
        if tools.tools:
            self.num_plate_tunnellings += count_tunnelled(
                self._plate_list.table, state, rows, tools, before
            )
        self.num_ground_tunnellings += finish_ground_contacts.for_threads(threads)(
            ground.surface, ground.frame, dt, params.settle_speed, rows, ground_contacts,
            state.position, state.velocity, state.radius, state.penetration_limited, state.settle_timer,
        )  # fmt: skip
        if locked_rows.size:
            self._sleep_manager.move_locked_loads(state, tools, locked_rows, locked_tool)
        self._wake_touching(rows)
        step_contacts = StepContacts(
            self._pair_contacts.blocks, self._plate_list.table.candidates, ground_contacts
        )
        if self._sleep_manager.put_to_sleep(state, tools, rows, inside, step_contacts, dt).size:
            self._records_stale = True
        tools.end_step()

    def _invalidate_contacts(self) -> None:
        """Have contacts collected anew in this step; before the pair list changes."""
        if not self._rebuild_contacts:
            self._pair_contacts.store_history(self._pairs.pairs, self._pairs.threads)
            self._rebuild_contacts = True

    def _wake_touching(self, rows: NDArray[np.int64]) -> None:
        state = self.state
        if rows.size < state.count and wake_touching(
            rows, self._pair_contacts.blocks, state.position, state.velocity, state.contact_radius,
            state.radius, self.params.wake_speed, state.sleep_state, state.wake_reference, state.sleep_timer,
        ):  # fmt: skip
            self._pairs.is_stale = True

    def _reserve_records(self) -> None:
        # Tools have records, too, in the last rows.
        count = self.state.count + len(self._tools.tools)
        if len(self._body_records) < count:
            room = max(count, 2 * len(self._body_records))
            self._body_records = np.zeros((room, BODY_RECORD_SIZE), np.float32)
            self._force_sums = np.zeros((room, FORCE_RECORD_SIZE), np.float32)
            self._ground_row = np.zeros(room, np.int64)
            self._plane = np.zeros((room, 4))
            self._records_stale = True

    def _grow(self, dt: float, ground_contacts: GroundContacts) -> None:
        state, params, pairs = self.state, self.params, self._pairs.pairs
        if self._has_unsized_particles:
            set_initial_radii(
                params.release_radius_fraction, pairs.first, pairs.second, pairs.count, state.position,
                state.radius, state.contact_radius, state.inverse_mass, self._plate_list.table.candidates,
                self._tools.motion, ground_contacts,
            )  # fmt: skip
            self._has_unsized_particles = False
        self._num_growing = grow_radii(
            pairs.first, pairs.second, pairs.count, state.position, state.radius,
            state.contact_radius, state.inverse_mass, growth_per_step(dt, params),
        )  # fmt: skip

    def _integrate(  # type: ignore[no-untyped-def]
        self, dt: float, pair_and_boundary_params: tuple[ContactParameters, ...], rows, moving, locked_rows, locked_tool,
        ground_contacts: GroundContacts, grows: bool,
    ) -> None:  # fmt: skip
        state, params, tools = self.state, self.params, self._tools
        body, force_sums = self._body_records, self._force_sums
        # Records of those that do not move stay good until rows change, or who moves.
        threads = self._pairs.threads
        load_body_records.for_threads(threads)(
            np.arange(state.count) if self._records_stale else moving, body, force_sums,
            state.velocity, state.angular_velocity, state.contact_radius, state.radius, state.inverse_mass,
            state.sleep_state,
        )  # fmt: skip
        self._records_stale = False
        self._pair_contacts.update(
            state,
            body,
            self._pairs.pairs,
            dt,
            threads,
            rebuild=self._rebuild_contacts,
            radii_changed=grows,
        )
        self._rebuild_contacts = False
        plate_contacts = self._plate_contacts.fill_blocks(
            state, self._plate_list.table, tools, body, force_sums
        )
        run_substeps.for_threads(threads)(
            params.substeps, params.gravity, pair_and_boundary_params, np.float32(params.ground_friction),
            np.float32(params.ground_rolling_friction), rows, locked_rows, locked_tool, body, force_sums,
            state.position, state.mass, state.radius, state.penetration_limited, state.ground_spring,
            self._pair_contacts.blocks, plate_contacts, tools.motion, ground_contacts,
        )  # fmt: skip
        self._plate_contacts.store_history(self._plate_list.table)
        store_body_records.for_threads(threads)(
            rows, body, state.position, state.velocity, state.angular_velocity
        )

    @property
    def max_overlap(self) -> float:
        """Largest overlap of two particles as a fraction of the smaller contact radius."""
        pairs, state = self._pairs.pairs, self.state
        if self._pairs.is_stale or self._pairs.num_listed < state.count:
            raise ParticleError("particles were added or removed; step before asking the overlap")
        return float(
            max_pair_overlap(
                pairs.first, pairs.second, pairs.count, state.position, state.contact_radius
            )
        )

    @property
    def num_list_builds(self) -> int:
        """How often the neighbour list was built."""
        return self._pairs.num_builds

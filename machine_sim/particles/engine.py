"""The particle engine: soil released by tools, moved by contacts, until it lands.

One step reads top to bottom: near pairs, ground planes and plates are listed, released particles
start and grow, substeps move all, and who got through a plate or the ground is counted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.ground import Ground
from machine_sim.particles.bodies import (
    BODY_FLOATS,
    SUM_FLOATS,
    finish_bodies,
    load_bodies,
)
from machine_sim.particles.growth import grow_radii, growth_in, start_radii
from machine_sim.particles.intake import checked_intake
from machine_sim.particles.law import Law, contact_law
from machine_sim.particles.motion import run_substeps
from machine_sim.particles.pairs.cells import spatial_order
from machine_sim.particles.pairs.contacts import ContactTable
from machine_sim.particles.pairs.forces import pair_overlap
from machine_sim.particles.pairs.neighbours import NeighbourList
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.pose import Pose
from machine_sim.particles.sleep import Sleep, Touching, who_moves
from machine_sim.particles.soil_contact import GroundContacts, finish_on_ground, ground_planes
from machine_sim.particles.soil_engine import SoilEngine
from machine_sim.particles.store import ParticleError
from machine_sim.particles.tool import RigidTool
from machine_sim.particles.waking import wake_touched
from machine_sim.particles.walls.contacts import WallContacts
from machine_sim.particles.walls.crossings import crossings
from machine_sim.particles.walls.listing import WallList
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["ParticleEngine"]

_REORDER_EVERY = 50
"""Builds of the neighbour list among many between two sortings of the rows by place."""
_MOST_MOVE = 0.75
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
        self._pairs = NeighbourList(params)
        self._walls = WallList()
        self._wall_contacts = WallContacts()
        self._contacts = ContactTable()
        self._body = np.zeros((0, BODY_FLOATS), np.float32)
        self._total = np.zeros((0, SUM_FLOATS), np.float32)
        self._ground_row = np.zeros(0, np.int64)
        self._plane = np.zeros((0, 4))
        self._sleep = Sleep(params)
        self._growing = 0
        self._fresh = False
        self._changed = True
        self._anew = True

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
        new = checked_intake(position, velocity, volume_mm3, soil, moisture)
        n, soils = len(new.position), new.soil.astype(np.int64)
        if n == 0:
            return np.zeros(0, dtype=np.uint32)
        self._grains.check(soils)
        kind = (soils, np.minimum(new.moisture, 100))
        grains = self._grains
        bank = new.volume_mm3 * 1e-9
        radius = grains.radius(bank, *kind)
        mass = bank * grains.density[soils]
        ids = self.store.add(
            n,
            position=new.position,
            place=new.position,
            velocity=new.velocity,
            radius=radius,
            contact_radius=0.0 if grow else radius,
            mass=mass,
            inverse_mass=1.0 / mass,
            volume_mm3=new.volume_mm3,
            soil=new.soil,
            moisture=new.moisture,
            friction=grains.friction[kind],
            rolling=grains.rolling[kind],
            cohesion=grains.cohesion[kind],
            tool_friction=grains.tool_friction[kind],
            tool_rolling=grains.tool_rolling[kind],
            adhesion=grains.adhesion[kind],
        )
        self._disturb(self.store.rows(ids))
        self._growing += n if grow else 0
        self._fresh |= grow
        return ids

    def remove(self, ids: ArrayLike) -> None:
        """See `SoilEngine.remove`."""
        rows = self.store.rows(ids)
        if rows.size:
            self._disturb(rows)
            self._renew()
            self._pairs.drop(self.store, self.store.remove(rows))
            self._changed = True

    def _disturb(self, rows: NDArray[np.intp]) -> None:
        """Wake what touches some particles that will not be there as before."""
        store = self.store
        reach = 1.1 * store.radius[rows].astype(np.float64)
        self._sleep.disturb(np.column_stack([store.position[rows], reach]))

    def freeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.freeze`."""
        rows = self.store.rows(ids)
        self._sleep.rouse(self.store, rows)
        self._changed = True
        self.store.frozen[rows] = True
        self.store.inverse_mass[rows] = 0.0
        self.store.velocity[rows] = 0.0
        self.store.spin[rows] = 0.0

    def unfreeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.unfreeze`."""
        rows = self.store.rows(ids)
        if rows.size == 0:
            return
        self._disturb(rows)
        self._pairs.stale = True
        self.store.frozen[rows] = False
        self.store.inverse_mass[rows] = 1.0 / self.store.mass[rows]
        self.store.quiet_time[rows] = 0.0

    # Tools.

    def add_tool(
        self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose, *, digs: bool = True
    ) -> None:
        """See `SoilEngine.add_tool`."""
        tool = RigidTool(plates, pose, digs=digs)
        self._tools.add(tool_id, tool)
        self._sleep.add_tool(tool)
        # It may stand where soil lies that sleeps.
        self._sleep.disturb(
            np.array([[*(tool.start[1] + tool.start[0] @ tool.centre), tool.reach]])
        )

    def remove_tool(self, tool_id: int) -> None:
        """See `SoilEngine.remove_tool`."""
        first = self._tools.first
        number = self._tools.remove(tool_id)
        self._sleep.remove_tool(number)
        self._walls.drop(int(first[number]), int(first[number + 1]))
        # What rested in it or against it is roused: all, since a tool goes away once in a while.
        rows = np.flatnonzero(self.store.resting)
        self._sleep.rouse(self.store, rows)
        self._pairs.stale = True

    def close(self) -> None:
        """See `SoilEngine.close`; there is nothing to free."""

    # Time.

    def step(self, dt: float) -> None:
        """Advance all particles by `dt` [s], in `params.substeps` substeps.

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """
        self._check_step(dt)
        store, params, ground, tools = self.store, self.params, self.ground, self._tools
        tools.begin(dt)
        self._make_room()
        if self._pairs.wear >= _REORDER_EVERY and store.count:
            store.reorder(spatial_order(store))
            self._pairs.stale = self._changed = True
            self._pairs.wear = 0
        if self._sleep.wake(store, tools, ground, dt).size:
            self._pairs.stale = True
        rows, riders, in_tool = who_moves(store.resting, store.frozen)
        if rows.size == 0:
            if riders.size:
                self._sleep.carry(store, tools, riders, in_tool)
            tools.end()
            return
        moving = np.concatenate([rows, riders]) if riders.size else rows
        # Ways are seen from the mean of all, but where many rest: those are then not looked at.
        seen = np.arange(store.count) if moving.size > _MOST_MOVE * store.count else moving
        if self._pairs.worn(store, seen, dt):
            self._renew()
            self._pairs.build(store, seen, dt)
        elif self._pairs.listed < store.count:
            self._renew()
            self._pairs.admit(store, seen, dt)
        substep = dt / params.substeps
        laws = (
            contact_law(substep, params.substeps_per_contact, params.restitution),
            contact_law(substep, params.substeps_per_contact, params.wall_restitution),
        )
        places = tools.places(rows, store.position)
        inside, lifted, near = tools.surround(places, ground.grid.cell)
        threads = self._pairs.threads
        count = ground_planes.on(threads)(
            ground.surface, ground.frame, dt, laws[1], rows, lifted, near, store.position,
            store.velocity, store.radius, store.contact_radius, store.soft, store.ground_spring,
            self._ground_row, self._plane,
        )  # fmt: skip
        grounds = GroundContacts(self._ground_row[:count], self._plane[:count])
        self._walls.refresh(store, rows, tools, places, dt)
        if self._changed:
            self._renew()
        grows = self._growing > 0
        if grows:
            self._grow(dt, grounds)
        before = store.position.take(rows, axis=0) if tools.tools else store.position[:0]
        self._move(dt, laws, rows, moving, riders, in_tool, grounds, grows)
        if tools.tools:
            self.tunnelled_tool += crossings(self._walls.table, store, rows, tools, before)
        self.tunnelled_ground += finish_on_ground.on(threads)(
            ground.surface, ground.frame, dt, params.settle_speed, rows, grounds,
            store.position, store.velocity, store.radius, store.soft, store.quiet_time,
        )  # fmt: skip
        if riders.size:
            self._sleep.carry(store, tools, riders, in_tool)
        self._wake_touched(rows)
        touching = Touching(self._contacts.blocks, self._walls.table.listed, grounds)
        if self._sleep.fall_asleep(store, tools, rows, inside, touching, dt).size:
            self._changed = True
        tools.end()

    def _renew(self) -> None:
        """Have contacts collected anew in this step; before the pair list changes."""
        if not self._anew:
            self._contacts.give_back(self._pairs.pairs, self._pairs.threads)
            self._anew = True

    def _wake_touched(self, rows: NDArray[np.int64]) -> None:
        store = self.store
        if rows.size < store.count and wake_touched(
            rows, self._contacts.blocks, store.position, store.velocity, store.contact_radius,
            store.radius, self.params.wake_speed, store.resting, store.place, store.calm_time,
        ):  # fmt: skip
            self._pairs.stale = True

    def _make_room(self) -> None:
        # Tools have records, too, in the last rows.
        count = self.store.count + len(self._tools.tools)
        if len(self._body) < count:
            room = max(count, 2 * len(self._body))
            self._body = np.zeros((room, BODY_FLOATS), np.float32)
            self._total = np.zeros((room, SUM_FLOATS), np.float32)
            self._ground_row = np.zeros(room, np.int64)
            self._plane = np.zeros((room, 4))
            self._changed = True

    def _grow(self, dt: float, grounds: GroundContacts) -> None:
        store, params, pairs = self.store, self.params, self._pairs.pairs
        if self._fresh:
            start_radii(
                params.release_size, pairs.first, pairs.second, pairs.count, store.position,
                store.radius, store.contact_radius, store.inverse_mass, self._walls.table.listed,
                self._tools.motion, grounds,
            )  # fmt: skip
            self._fresh = False
        self._growing = grow_radii(
            pairs.first, pairs.second, pairs.count, store.position, store.radius,
            store.contact_radius, store.inverse_mass, growth_in(dt, params),
        )  # fmt: skip

    def _move(  # type: ignore[no-untyped-def]
        self, dt: float, laws: tuple[Law, ...], rows, moving, riders, in_tool,
        grounds: GroundContacts, grows: bool,
    ) -> None:  # fmt: skip
        store, params, tools = self.store, self.params, self._tools
        body, total = self._body, self._total
        # Records of those that do not move stay good until rows change, or who moves.
        threads = self._pairs.threads
        load_bodies.on(threads)(
            np.arange(store.count) if self._changed else moving, body, total,
            store.velocity, store.spin, store.contact_radius, store.radius, store.inverse_mass,
            store.resting,
        )  # fmt: skip
        self._changed = False
        self._contacts.collect(
            store, body, self._pairs.pairs, dt, threads, anew=self._anew, grown=grows
        )
        self._anew = False
        walls = self._wall_contacts.lay_out(store, self._walls.table, tools, body, total)
        run_substeps.on(threads)(
            params.substeps, params.gravity, laws, np.float32(params.ground_friction),
            np.float32(params.ground_rolling), rows, riders, in_tool, body, total,
            store.position, store.mass, store.radius, store.soft, store.ground_spring,
            self._contacts.blocks, walls, tools.motion, grounds,
        )  # fmt: skip
        self._wall_contacts.give_back(self._walls.table)
        finish_bodies.on(threads)(rows, body, store.position, store.velocity, store.spin)

    @property
    def max_overlap(self) -> float:
        """Largest overlap of two particles as a fraction of the smaller contact radius."""
        pairs, store = self._pairs.pairs, self.store
        if self._pairs.stale or self._pairs.listed < store.count:
            raise ParticleError("particles were added or removed; step before asking the overlap")
        return float(
            pair_overlap(
                pairs.first, pairs.second, pairs.count, store.position, store.contact_radius
            )
        )

    @property
    def pair_builds(self) -> int:
        """How often the neighbour list was built."""
        return self._pairs.builds

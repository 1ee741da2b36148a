"""The particle engine: soil as spheres, moved by contact forces until it is deposited."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.contact_dynamics import ContactDynamics
from machine_sim.dem.contacts.pair_forces import max_pair_overlap
from machine_sim.dem.invalidation import Change
from machine_sim.dem.neighbours.verlet_list import VerletList
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.sleep.sleep_manager import SleepManager
from machine_sim.dem.sleep.sleep_state import AWAKE, wake_rows
from machine_sim.dem.sleep.wake_conditions import WAKE_SPHERE_SIZE
from machine_sim.dem.soil_engine import SoilEngine, read_only
from machine_sim.dem.state import ParticleError
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import SPHERE_RADIUS, ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["ParticleEngine"]

_WAKE_REACH = 1.1
"""Radius within which a particle that changes wakes others, in its radii."""


class ParticleEngine(SoilEngine):
    """Soil as spheres with contacts, sleep and growth.

    Data that is kept from step to step is rebuilt as `invalidation` describes.
    """

    def __init__(
        self,
        params: ParticleParams,
        ground: Ground,
        *,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
    ) -> None:
        """Make an engine without particles.

        Args:
            params: parameters of the physics.
            ground: terrain.
            soils: all soil types of the terrain, in the order of their ids.

        Raises:
            ParticleError: no soil type.
        """
        super().__init__(params, ground, soils, params.substeps)
        self._dynamics = ContactDynamics(params, self.state, ground, self._tools)
        self._sleep_manager = SleepManager(params.gravity)

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
        batch = self._validate_release(position, velocity, volume_mm3, soil, moisture)
        if len(batch.position) == 0:
            return np.zeros(0, dtype=np.uint32)
        materials = self._materials
        kind = (batch.soil.astype(np.int64), np.minimum(batch.moisture, 100))
        bank = batch.volume_mm3 * 1e-9
        radius = materials.radius(bank, *kind)
        mass = bank * materials.density[batch.soil]
        ids = self.state.add(
            len(bank),
            **batch._asdict(),
            wake_reference=batch.position,
            radius=radius,
            contact_radius=0.0 if grow else radius,
            mass=mass,
            inverse_mass=1.0 / mass,
            **materials.coefficients(*kind)._asdict(),
        )
        first = self.state.count - len(ids)
        self._wake_near_rows(np.arange(first, self.state.count))
        self._dynamics.include_added(len(ids), grow=grow)
        return ids

    def continue_from(self, other: ParticleEngine) -> None:
        """Take the particles of an engine with other parameters, with their ids.

        They are awake, and have the sizes, masses and coefficients of these parameters. Where a
        kind of soil has another moisture of its own, theirs changes by the same difference.
        Contacts have no tangential displacement. This engine has no particles before.

        Raises:
            ParticleError: more particles than the capacity.
        """
        state, before = self.state, other.state
        now, then = (np.array([kind.moisture for kind in engine.soils]) for engine in (self, other))
        moisture = np.clip(before.moisture + (now - then)[before.soil], 0, MOISTURE_LEVELS - 1)
        self.add(before.position, before.velocity, before.volume_mm3, before.soil, moisture)
        grown = before.contact_radius / before.radius
        state.contact_radius[:] = grown * state.radius
        state.angular_velocity[:] = before.angular_velocity
        state.settle_timer[:] = before.settle_timer
        state.renumber(before.particle_id, before.next_id)
        self._freeze_rows(np.flatnonzero(before.frozen))

    def remove(self, ids: ArrayLike) -> None:
        """Remove particles; see `SoilEngine.remove`."""
        rows = self.state.rows(ids)
        if rows.size:
            self._wake_near_rows(rows)
            self._dynamics.remove_rows(rows)

    def freeze(self, ids: ArrayLike) -> None:
        """Fix particles where they are; see `SoilEngine.freeze`."""
        rows = self.state.rows(ids)
        wake_rows(rows, self.state.boxed)
        self._freeze_rows(rows)
        self._dynamics.invalidate(Change.PARTICLES_FROZEN)

    def unfreeze(self, ids: ArrayLike) -> None:
        """Let frozen particles move again; see `SoilEngine.unfreeze`."""
        rows = self.state.rows(ids)
        if rows.size:
            self._wake_near_rows(rows)
            self._unfreeze_rows(rows)
            self._dynamics.invalidate(Change.PARTICLES_UNFROZEN)

    def wake(self, ids: ArrayLike) -> None:
        """Wake sleeping particles, which fall asleep again once they have been at rest.

        Raises:
            ParticleError: an id that does not exist or is given twice.
        """
        self._wake_rows(self.state.rows(ids))

    def _wake_rows(self, rows: NDArray[np.intp]) -> None:
        wake_rows(rows, self.state.boxed)
        self._dynamics.invalidate(Change.PARTICLES_WOKEN)

    def _wake_near_rows(self, rows: NDArray[np.intp]) -> None:
        """Wake the particles next to some that change: their support may be gone."""
        state = self.state
        reach = _WAKE_REACH * state.radius[rows].astype(np.float64)
        self.wake_in_spheres(state.position[rows], reach)

    def wake_in_spheres(self, centres: NDArray[np.float64], radii: NDArray[np.float64]) -> None:
        """Wake the particles that reach into spheres in the next step; [m], shapes (n, 3), (n,)."""
        spheres = np.empty((len(radii), WAKE_SPHERE_SIZE))
        spheres[:, :SPHERE_RADIUS], spheres[:, SPHERE_RADIUS] = centres, radii
        self._sleep_manager.request_wake(spheres)

    def sort_rows(self) -> None:
        """Sort the rows so that neighbours in space are neighbours in memory."""
        self._dynamics.sort_rows()

    # Tools.

    def _include_tool(self, tool_id: int, tool: RigidTool, plates: Sequence[ArrayLike]) -> None:
        self._sleep_manager.add_tool(tool)
        # The tool may touch soil that sleeps.
        rotation, origin = tool.start
        centre = origin + rotation @ tool.centre
        self.wake_in_spheres(centre[None], np.array([tool.bounding_radius]))

    def remove_tool(self, tool_id: int) -> None:
        """Remove a tool; see `SoilEngine.remove_tool`."""
        first_plate = self._tools.first_plate
        index = self._tools.remove(tool_id)
        self._sleep_manager.remove_tool(index)
        self._dynamics.plate_list.remove(int(first_plate[index]), int(first_plate[index + 1]))
        # All particles wake: this is rare, and their states refer to tools by index.
        self._wake_rows(np.flatnonzero(self.state.sleep_state != AWAKE))

    def close(self) -> None:
        """Do nothing: this engine has no external resources."""

    # Time.

    def step(self, dt: float) -> None:
        """Advance all particles by `dt` [s], in `params.substeps` substeps.

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """
        self._validate_step(dt)
        result = self._dynamics.advance(dt, self._sleep_manager)
        self.num_plate_tunnellings += result.num_tunnelled
        self.num_ground_tunnellings += result.num_recovered

    # Present state.

    @property
    def neighbour_list(self) -> VerletList:
        """Neighbour list of the last step, for the modules and tests of `machine_sim.dem`."""
        return self._dynamics.neighbour_list

    @property
    def tools(self) -> ToolSet:
        """Tools in the last step, for the modules and tests of `machine_sim.dem`."""
        return self._tools

    def store_springs(self) -> None:
        """Copy the springs of the contacts to the table of the neighbour list."""
        self._dynamics.store_springs()

    @property
    def contact_radii(self) -> NDArray[np.float32]:
        """Radii that contacts use [m], below `radii` while a particle grows, shape (n,)."""
        return read_only(self.state.contact_radius)

    @property
    def sleep_states(self) -> NDArray[np.int16]:
        """Sleep states, shape (n,); see `sleep.sleep_state`."""
        return read_only(self.state.sleep_state)

    @property
    def max_overlap(self) -> float:
        """Maximum overlap of two particles as a fraction of the smaller contact radius.

        Raises:
            ParticleError: particles were added or removed since the last step.
        """
        pair_list, state = self.neighbour_list, self.state
        if pair_list.is_stale or pair_list.num_listed < state.count:
            raise ParticleError("the neighbour list is out of date; call step first")
        pairs = pair_list.pairs
        return float(
            max_pair_overlap(
                pairs.first, pairs.second, pairs.count, state.position, state.contact_radius
            )
        )

"""The particle engine: soil released by tools, moved by contacts, until it lands.

One step reads top to bottom: near pairs, ground planes and plates are listed, released particles
start and grow, substeps move all, and who got through a plate or the ground is counted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.ground import Ground
from machine_sim.particles.growth import grow_radii, start_radii
from machine_sim.particles.landing import settled_rows
from machine_sim.particles.law import Law, contact_law
from machine_sim.particles.motion import run_substeps
from machine_sim.particles.neighbours import NeighbourList, spatial_order
from machine_sim.particles.pairs import pair_buffer, pair_overlap
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.soil_contact import finish_on_ground, ground_planes
from machine_sim.particles.store import ParticleError, ParticleStore
from machine_sim.particles.tool import Pose, RigidTool, ToolSet
from machine_sim.particles.walls import WallList
from msg_bridge.contract.rows import MAX_ROW_VOLUME

__all__ = ["ParticleEngine"]

_REORDER_EVERY = 50
"""Builds of the neighbour list between two sortings of the rows by place."""


class ParticleEngine:
    """Particles of one machine node, and the tools and terrain they touch.

    Attributes:
        params: physics.
        ground: terrain; `Ground.advance` is its owner's to call.
        swell: loose volume over bank volume, minus 1, by soil; or one for all, shape (1,).
        density: of undisturbed soil [kg/m^3], likewise.
        store: the particles, see `ParticleStore`; rows may be reordered by `step`.
        tunnelled_tool: centres that went through a plate so far.
        tunnelled_ground: centres that sank a radius into the ground so far, soft ones apart; put
            back upon it.
    """

    def __init__(
        self,
        params: ParticleParams,
        ground: Ground,
        *,
        swell: float | Sequence[float] = 0.25,
        density: float | Sequence[float] = 1600.0,
    ) -> None:
        """An engine without particles.

        Args:
            swell: loose volume over bank volume, minus 1; one for all soils, or by soil.
            density: of undisturbed soil [kg/m^3], likewise.

        Raises:
            ParticleError: a swell below 0 or above 2, or a density below 1 or above 1e5.
        """
        self.params = params
        self.ground = ground
        self.swell = _by_soil("swell", swell, 0.0, 2.0)
        self.density = _by_soil("density", density, 1.0, 1e5)
        self.store = ParticleStore(params.capacity)
        self.tunnelled_tool = 0
        self.tunnelled_ground = 0
        self._tools = ToolSet(params.substeps)
        self._pairs = NeighbourList(params.skin)
        self._walls = WallList()
        self._buffer, self._slots = pair_buffer()
        self._force = np.zeros((0, 3), np.float32)
        self._ground_row = np.zeros(0, np.int64)
        self._plane = np.zeros((0, 4))
        self._growing = 0
        self._order_due = _REORDER_EVERY

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
        """Release soil as particles.

        Args:
            position, velocity: [m], [m/s], map frame, shape (n, 3).
            volume_mm3: bank volume of each [mm^3], whole numbers, shape (n,) or one for all.
            soil, moisture: codes 0..255, shape (n,) or one for all.
            grow: start small and grow, for soil that comes loose among other soil.

        Returns:
            Ids, shape (n,), uint32.

        Raises:
            ParticleError: shapes that do not fit, values that are not finite, volumes or codes
                out of range, or no room; nothing was added.
        """
        x = np.atleast_2d(np.asarray(position, dtype=np.float64))
        v = np.atleast_2d(np.asarray(velocity, dtype=np.float64))
        n = len(x) if x.size else 0
        volume, codes = np.asarray(volume_mm3), np.stack(np.broadcast_arrays(soil, moisture))
        if x.shape != v.shape or (n and x.shape != (n, 3)):
            raise ParticleError("positions and velocities must both have shape (n, 3)")
        if volume.shape not in ((), (n,)) or codes.shape[1:] not in ((), (n,)):
            raise ParticleError("volumes, soils and moistures must be one per particle, or one")
        if n == 0:
            return np.zeros(0, dtype=np.uint32)
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            raise ParticleError("positions and velocities must be finite")
        if volume.dtype.kind not in "iu" or volume.min() < 1 or volume.max() > MAX_ROW_VOLUME:
            raise ParticleError(f"volumes are whole numbers of mm^3 from 1 to {MAX_ROW_VOLUME}")
        if codes.dtype.kind not in "iu" or codes.min() < 0 or codes.max() > 255:
            raise ParticleError("soil and moisture codes are whole numbers from 0 to 255")
        bank = volume.astype(np.float64) * 1e-9
        sphere = bank * (1.0 + self._of("swell", self.swell, codes[0])) * self.params.packing
        radius = np.cbrt(0.75 / math.pi * sphere)
        mass = bank * self._of("density", self.density, codes[0])
        ids = self.store.add(
            n,
            position=x,
            velocity=v,
            radius=radius,
            contact_radius=0.0 if grow else radius,
            mass=mass,
            inverse_mass=1.0 / mass,
            volume_mm3=volume,
            soil=codes[0],
            moisture=codes[1],
        )
        self._pairs.stale = True
        self._growing += n if grow else 0
        return ids

    @staticmethod
    def _of(name: str, values: NDArray[np.float64], soil: NDArray[np.integer]) -> Any:
        """Values of soils, from a table by soil or one for all."""
        if values.size == 1:
            return values[0]
        if soil.max() >= values.size:
            raise ParticleError(
                f"the {name} of soil {soil.max()} is not known, only of {values.size} soils;"
                " give that of all soils of the terrain"
            )
        return values[soil]

    def remove(self, ids: ArrayLike) -> None:
        """Take particles out of the account.

        Raises:
            ParticleError: an id that is not alive or given twice; nothing was removed.
        """
        rows = self.store.rows(ids)
        if rows.size:
            self.store.remove(rows)
            self._pairs.stale = True

    def freeze(self, ids: ArrayLike) -> None:
        """Hold particles where they are: landed, not yet answered; still counted and in the way.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        rows = self.store.rows(ids)
        self.store.frozen[rows] = True
        self.store.inverse_mass[rows] = 0.0
        self.store.velocity[rows] = 0.0

    def unfreeze(self, ids: ArrayLike) -> None:
        """Let frozen particles go, from rest.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        rows = self.store.rows(ids)
        self.store.frozen[rows] = False
        self.store.inverse_mass[rows] = 1.0 / self.store.mass[rows]
        self.store.quiet_time[rows] = 0.0

    def settled(self) -> NDArray[np.uint32]:
        """Ids of particles that should land, ascending; see `landing.settled_rows`."""
        rows = settled_rows(self.store, self.ground, self._tools.tools, self.params)
        return np.asarray(self.store.particle_id[rows], dtype=np.uint32)

    # Tools.

    def add_tool(self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose) -> None:
        """Let a tool touch particles.

        Args:
            tool_id: the caller's number for it.
            plates: convex planar polygons, each (k, 3) corners [m] in order around, tool frame.
            pose: where it is.

        Raises:
            ParticleError: the id is taken, or a plate or the pose is not what it should be.
        """
        self._tools.add(tool_id, RigidTool(plates, pose))

    def set_tool(self, tool_id: int, start: Pose, end: Pose) -> None:
        """Move a tool from `start` to `end` in the next step; without this it rests.

        Raises:
            ParticleError: no such tool, no pose, or a turn of 90 degrees or more.
        """
        self._tools[tool_id].move(start, end)

    def tool_wrench(self, tool_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the particles on a tool, and torque about its frame origin [N m].

        Map axes, mean over the last step, shape (3,) each.
        """
        _ = self._tools[tool_id]
        wrench = self._tools.wrench[self._tools.number[tool_id]]
        return wrench[:3].copy(), wrench[3:].copy()

    def tool_local(self, tool_id: int) -> NDArray[np.float64]:
        """Positions of all particles [m] in the frame of a tool, in row order, shape (n, 3)."""
        return self._tools[tool_id].local(self.store.position)

    # Time.

    def step(self, dt: float) -> None:
        """Advance all particles by `dt` [s], in `params.substeps` substeps.

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """
        if not 0.0 < dt <= 0.1:
            raise ParticleError(f"dt is {dt} s; give a step above 0 and up to 0.1 s")
        store, params, ground = self.store, self.params, self.ground
        self._tools.begin(dt)
        self._make_room()
        if self._order_due <= self._pairs.builds and store.count:
            store.reorder(spatial_order(store))
            self._pairs.stale = True
            self._order_due = self._pairs.builds + _REORDER_EVERY
        self._pairs.refresh(store, dt)
        law = contact_law(dt / params.substeps, params.substeps_per_contact, params.restitution)
        held, near = self._tools.surround(store.position, ground.grid.cell)
        off_ground = store.frozen | held
        grounds = ground_planes(
            ground.surface, ground.frame, dt, law, store.position, store.velocity, store.radius,
            store.contact_radius, off_ground, near, store.soft, store.ground_spring,
            self._ground_row, self._plane,
        )  # fmt: skip
        self._walls.refresh(store, self._tools, dt)
        if self._growing:
            self._grow(dt, grounds)
        before = store.position.copy()
        self._move(law, grounds)
        self.tunnelled_tool += int(self._walls.crossed(store, self._tools, before).sum())
        self.tunnelled_ground += finish_on_ground(
            ground.surface, ground.frame, dt, params.settle_speed, grounds, self._ground_row,
            self._plane, store.position, store.velocity, store.radius, off_ground,
            store.soft, store.quiet_time,
        )  # fmt: skip
        self._tools.end()

    def _make_room(self) -> None:
        count = self.store.count
        if len(self._force) < count:
            room = max(count, 2 * len(self._force))
            self._force = np.zeros((room, 3), np.float32)
            self._ground_row = np.zeros(room, np.int64)
            self._plane = np.zeros((room, 4))

    def _grow(self, dt: float, grounds: int) -> None:
        store, params, tools = self.store, self.params, self._tools
        pairs, walls = self._pairs.pairs, self._walls.table
        start_radii(
            params.release_size, pairs.first, pairs.second, pairs.count, store.position,
            store.radius, store.contact_radius, walls.count, walls.row, walls.plate,
            tools.frame, tools.corner, tools.corners, tools.owner, tools.path[0],
            grounds, self._ground_row, self._plane,
        )  # fmt: skip
        share = dt * (1.0 - params.release_size) / max(params.growth_time, dt)
        self._growing = grow_radii(
            pairs.first, pairs.second, pairs.count, store.position, store.radius,
            store.contact_radius, share,
        )  # fmt: skip

    def _move(self, law: Law, grounds: int) -> None:
        store, params, tools = self.store, self.params, self._tools
        pairs, walls = self._pairs.pairs, self._walls.table
        run_substeps(
            params.substeps, params.gravity, law, np.float32(params.friction),
            np.float32(params.tool_friction), np.float32(params.ground_friction),
            store.position, store.velocity, store.mass, store.inverse_mass,
            store.radius, store.contact_radius, store.soft,
            self._force[: store.count], store.ground_spring,
            pairs.first, pairs.second, pairs.count, pairs.touching, pairs.spring,
            self._buffer, self._slots,
            walls.count, walls.row, walls.plate, walls.spring, walls.side,
            tools.frame, tools.corner, tools.corners, tools.owner, tools.path, tools.twist,
            tools.wrench, grounds, self._ground_row, self._plane,
        )  # fmt: skip

    # What it is like now.

    def index_of(self, ids: ArrayLike) -> NDArray[np.intp]:
        """Rows of particles in `store`, good until the next step, add or remove.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        return self.store.rows(ids)

    @property
    def room(self) -> int:
        """How many particles can still be added."""
        return self.store.capacity - self.store.count

    @property
    def count(self) -> int:
        """Number of particles, frozen ones included."""
        return self.store.count

    @property
    def total_volume_mm3(self) -> int:
        """Bank volume of all particles [mm^3], frozen ones included, exact."""
        return self.store.total_volume_mm3

    @property
    def kinetic_energy(self) -> float:
        """Of all particles [J]."""
        return float(0.5 * (self.store.mass[:, None] * self.store.velocity**2).sum())

    @property
    def max_overlap(self) -> float:
        """Largest overlap of two particles as a fraction of the smaller contact radius."""
        pairs, store = self._pairs.pairs, self.store
        if self._pairs.stale:
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


def _by_soil(
    name: str, given: float | Sequence[float], least: float, most: float
) -> NDArray[np.float64]:
    values = np.atleast_1d(np.asarray(given, dtype=np.float64))
    if values.ndim != 1 or not values.size or not ((values >= least) & (values <= most)).all():
        raise ParticleError(
            f"{name} is {given}; give values from {least:g} to {most:g}, one a soil"
        )
    return values

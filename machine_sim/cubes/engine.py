"""The cube engine: soil as rigid cubes in pybullet, with the interface of `ParticleEngine`.

One step reads top to bottom: tools are put in place with their velocities, the reference's clamps
and the terrain change velocities, pybullet moves all, who landed or got through is counted, and
the forces on the tools are added up.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import ArrayLike, NDArray

from machine_sim.cubes.around import look_around
from machine_sim.cubes.bodies import CubeBodies, own_friction
from machine_sim.cubes.clamps import VelocityClamps, clamp_velocities
from machine_sim.cubes.plates import PlateBodies, pierced
from machine_sim.cubes.terrain import finish_on_ground, stand_on_ground
from machine_sim.ground import Ground
from machine_sim.particles.grains import GrainTables
from machine_sim.particles.intake import checked_intake
from machine_sim.particles.landing import settled_rows
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.store import ParticleError, ParticleStore
from machine_sim.particles.tool import Pose, RigidTool, ToolSet
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["CubeEngine"]

SOLVER_ITERATIONS = 20
"""Sweeps of Bullet's contact solver; the reference leaves Unity's at 6 (section 4.2), Bullet's own
default is 50."""


class CubeEngine:
    """Cubes of soil, and the tools and terrain they touch.

    Of the parameters count: capacity, gravity, ground_friction and those of landing. Soils have
    friction, swell and density; the reference's cubes neither stick nor grow.

    Attributes:
        params: physics.
        ground: terrain; `Ground.advance` is its owner's to call.
        soils: what is known of each soil, by its id.
        clamps: the reference's velocity constraints.
        store: the cubes, see `ParticleStore`; `radius` is half an edge.
        tunnelled_tool: centres that went through a plate so far.
        tunnelled_ground: centres that sank half an edge into the ground so far, soft ones apart;
            put back upon it.
    """

    def __init__(
        self,
        params: ParticleParams,
        ground: Ground,
        *,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
        clamps: VelocityClamps | None = None,
    ) -> None:
        """An engine without cubes, with a pybullet client of its own.

        Args:
            soils: all soils of the terrain, in the order of their ids.
            clamps: defaults as shipped.

        Raises:
            ParticleError: no soil.
        """
        self.params = params
        self.ground = ground
        self.soils = tuple(soils)
        self._grains = GrainTables(self.soils)
        self.clamps = clamps or VelocityClamps()
        self.store = ParticleStore(params.capacity)
        self.tunnelled_tool = 0
        self.tunnelled_ground = 0
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._free = weakref.finalize(self, pybullet.disconnect, self._client)
        pybullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1,
            numSolverIterations=SOLVER_ITERATIONS,
            physicsClientId=self._client,
        )
        pybullet.setGravity(0.0, 0.0, -params.gravity, physicsClientId=self._client)
        self._bodies = CubeBodies(self._client)
        self._plates = PlateBodies(self._client)
        self._tools = ToolSet(1)

    def close(self) -> None:
        """Free the pybullet client; also happens when nothing refers to the engine any more."""
        self._free()

    # Cubes in and out.

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
        """Release soil as cubes, level with the map's axes; see `ParticleEngine.add`.

        Args:
            grow: makes no difference, cubes have their full size at once.

        Raises:
            ParticleError: as there; nothing was added.
        """
        new = checked_intake(position, velocity, volume_mm3, soil, moisture)
        self._grains.check(new.soil)
        bank = new.volume_mm3 * 1e-9
        half = 0.5 * np.cbrt(bank * (1.0 + self._grains.swell[new.soil]))
        mass = bank * self._grains.density[new.soil]
        kinds = zip(new.soil.tolist(), np.minimum(new.moisture, 100).tolist(), strict=True)
        own = np.array([own_friction(self.soils[kind].repose_angle(wet)) for kind, wet in kinds])
        ids = self.store.add(
            len(bank),
            **new._asdict(),
            radius=half,
            contact_radius=half,
            mass=mass,
            inverse_mass=1.0 / mass,
            friction=own**2,
        )
        self._bodies.add(new.position, half, mass, own)
        return ids

    def remove(self, ids: ArrayLike) -> None:
        """Take cubes out of the account.

        Raises:
            ParticleError: an id that is not alive or given twice; nothing was removed.
        """
        rows = self.store.rows(ids)
        if rows.size:
            self.store.remove(rows)
            self._bodies.remove(rows)

    def freeze(self, ids: ArrayLike) -> None:
        """Hold cubes where they are: landed, not yet answered; still counted and in the way.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        rows = self.store.rows(ids)
        self.store.frozen[rows] = True
        self.store.inverse_mass[rows] = 0.0
        self.store.velocity[rows] = 0.0
        self.store.spin[rows] = 0.0
        self._bodies.weigh(rows, np.zeros(rows.size))

    def unfreeze(self, ids: ArrayLike) -> None:
        """Let frozen cubes go, from rest.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        rows = self.store.rows(ids)
        self.store.frozen[rows] = False
        self.store.inverse_mass[rows] = 1.0 / self.store.mass[rows]
        self.store.quiet_time[rows] = 0.0
        self._bodies.weigh(rows, self.store.mass[rows])

    def settled(self) -> NDArray[np.uint32]:
        """Ids of cubes that should land, ascending; see `landing.settled_rows`."""
        rows = settled_rows(self.store, self.ground, self._tools.tools, self.params)
        return np.asarray(self.store.particle_id[rows], dtype=np.uint32)

    # Tools.

    def add_tool(
        self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose, *, digs: bool = True
    ) -> None:
        """Let a tool touch cubes; see `ParticleEngine.add_tool`.

        Raises:
            ParticleError: the id is taken, or a plate or the pose is not what it should be.
        """
        tool = RigidTool(plates, pose, digs=digs)
        self._tools.add(tool_id, tool)
        self._plates.add(tool_id, tool, plates, self._tool_friction())

    def remove_tool(self, tool_id: int) -> None:
        """Take a tool away; what lay in it falls.

        Raises:
            ParticleError: no such tool.
        """
        self._tools.remove(tool_id)
        self._plates.remove(tool_id)

    def set_tool(self, tool_id: int, start: Pose, end: Pose) -> None:
        """Move a tool from `start` to `end` in the next step; without this it rests.

        Raises:
            ParticleError: no such tool, no pose, or a turn of 90 degrees or more.
        """
        self._tools[tool_id].move(start, end)

    def tool_wrench(self, tool_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the cubes on a tool, and torque about its frame origin [N m].

        Map axes, in the last step, shape (3,) each. What the clamps take is not in it.
        """
        _ = self._tools[tool_id]
        wrench = self._tools.wrench[self._tools.number[tool_id]]
        return wrench[:3].copy(), wrench[3:].copy()

    def tool_local(self, tool_id: int) -> NDArray[np.float64]:
        """Positions of all cubes [m] in the frame of a tool, in row order, shape (n, 3)."""
        return self._tools[tool_id].local(self.store.position)

    def _tool_friction(self) -> float:
        """What makes friction against steel of a cube's own, dry, on the mean of the soils."""
        ratios = [
            math.tan(math.radians(soil.tool_friction))
            / max(own_friction(soil.repose_angle(0)), 0.1)
            for soil in self.soils
        ]
        return sum(ratios) / len(ratios)

    # Time.

    def step(self, dt: float) -> None:
        """Advance all cubes by `dt` [s], in one step of Bullet.

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """
        if not 0.0 < dt <= 0.1:
            raise ParticleError(f"dt is {dt} s; give a step above 0 and up to 0.1 s")
        store, params, ground, tools = self.store, self.params, self.ground, self._tools
        tools.begin(dt)
        for tool_id, k in tools.number.items():
            self._plates.place(tool_id, tools.tools[k].start, tools.twist[k])
        around = look_around(tools, store.position, 2.0 * store.radius, ground.grid.cell)
        clamp_velocities(self.clamps, dt, around, store.frozen, store.velocity)
        off_ground = store.frozen | around.held
        stand_on_ground(
            ground.surface, ground.frame, dt, params.gravity, params.ground_friction, off_ground,
            around.near, store.position, self._bodies.quaternion, store.radius, self._bodies.load,
            self._bodies.load_spin, store.soft, store.velocity, store.spin,
        )  # fmt: skip
        self._bodies.push(store)
        before = store.position.copy()
        pybullet.setTimeStep(dt, physicsClientId=self._client)
        pybullet.stepSimulation(physicsClientId=self._client)
        self._bodies.pull(store, params.gravity * dt)
        through = pierced(tools, before, store.position) & ~store.frozen
        self.tunnelled_tool += int(through.sum())
        self.tunnelled_ground += finish_on_ground(
            ground.surface, ground.frame, dt, params.settle_speed, off_ground, store.position,
            store.velocity, store.spin, store.radius, store.soft, store.quiet_time,
        )  # fmt: skip
        for tool_id, k in tools.number.items():
            tools.wrench[k] = self._plates.wrench(tool_id, tools.tools[k].start[1])
        tools.end()

    # What it is like now.

    def index_of(self, ids: ArrayLike) -> NDArray[np.intp]:
        """Rows of cubes in `store`, good until the next add or remove.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        return self.store.rows(ids)

    @property
    def room(self) -> int:
        """How many cubes can still be added."""
        return self.store.capacity - self.store.count

    @property
    def count(self) -> int:
        """Number of cubes, frozen ones included."""
        return self.store.count

    @property
    def total_volume_mm3(self) -> int:
        """Bank volume of all cubes [mm^3], frozen ones included, exact."""
        return self.store.total_volume_mm3

    @property
    def kinetic_energy(self) -> float:
        """Of all cubes [J], that of turning left out as there."""
        return float(0.5 * (self.store.mass[:, None] * self.store.velocity**2).sum())

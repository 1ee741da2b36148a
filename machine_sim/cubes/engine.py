"""The cube engine: soil as rigid cubes in pybullet.

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
from machine_sim.particles.intake import checked_intake
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.pose import Pose
from machine_sim.particles.soil_engine import SoilEngine
from machine_sim.particles.tool import RigidTool
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["CubeEngine"]

SOLVER_ITERATIONS = 20
"""Sweeps of Bullet's contact solver; the reference leaves Unity's at 6 (section 4.2), Bullet's own
default is 50."""


class CubeEngine(SoilEngine):
    """Soil as cubes; in the store, `radius` is half an edge.

    Of the parameters count: capacity, gravity, ground_friction and those of landing. Soils have
    friction, swell and density; the reference's cubes neither stick nor grow.

    Attributes:
        clamps: the reference's velocity constraints.
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
        super().__init__(params, ground, soils, substeps=1)
        self.clamps = clamps or VelocityClamps()
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
        """Release soil as cubes, level with the map's axes; see `SoilEngine.add`.

        Args:
            grow: makes no difference, cubes have their full size at once.
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
        """See `SoilEngine.remove`."""
        rows = self.store.rows(ids)
        if rows.size:
            self.store.remove(rows)
            self._bodies.remove(rows)

    def freeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.freeze`."""
        rows = self.store.rows(ids)
        self.store.frozen[rows] = True
        self.store.inverse_mass[rows] = 0.0
        self.store.velocity[rows] = 0.0
        self.store.spin[rows] = 0.0
        self._bodies.weigh(rows, np.zeros(rows.size))

    def unfreeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.unfreeze`."""
        rows = self.store.rows(ids)
        self.store.frozen[rows] = False
        self.store.inverse_mass[rows] = 1.0 / self.store.mass[rows]
        self.store.quiet_time[rows] = 0.0
        self._bodies.weigh(rows, self.store.mass[rows])

    # Tools.

    def add_tool(
        self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose, *, digs: bool = True
    ) -> None:
        """See `SoilEngine.add_tool`."""
        tool = RigidTool(plates, pose, digs=digs)
        self._tools.add(tool_id, tool)
        self._plates.add(tool_id, tool, plates, self._tool_friction())

    def remove_tool(self, tool_id: int) -> None:
        """See `SoilEngine.remove_tool`."""
        self._tools.remove(tool_id)
        self._plates.remove(tool_id)

    def tool_wrench(self, tool_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `SoilEngine.tool_wrench`; what the clamps take is not in it."""
        return super().tool_wrench(tool_id)

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
        self._check_step(dt)
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

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
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.lifecycle.release_validation import validate_release
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.soil_engine import SoilEngine
from machine_sim.dem.tools.pose import Pose
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.ground.contact_surface import Ground
from machine_sim.physics_engine import pybullet
from machine_sim.reference_cubes.cube_bodies import CubeBodies, bullet_friction
from machine_sim.reference_cubes.ground_contacts import (
    finish_ground_contacts,
    resolve_ground_contacts,
)
from machine_sim.reference_cubes.plate_bodies import PlateBodies, find_tunnelled
from machine_sim.reference_cubes.tool_proximity import find_tool_proximity
from machine_sim.reference_cubes.velocity_clamps import VelocityClamps, clamp_velocities
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
        new = validate_release(position, velocity, volume_mm3, soil, moisture)
        self._materials.validate_soil_ids(new.soil)
        bank = new.volume_mm3 * 1e-9
        half = 0.5 * np.cbrt(bank * (1.0 + self._materials.swell[new.soil]))
        mass = bank * self._materials.density[new.soil]
        kinds = zip(new.soil.tolist(), np.minimum(new.moisture, 100).tolist(), strict=True)
        own = np.array([bullet_friction(self.soils[kind].repose_angle(wet)) for kind, wet in kinds])
        ids = self.state.add(
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
        rows = self.state.rows(ids)
        if rows.size:
            self.state.remove(rows)
            self._bodies.remove(rows)

    def freeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.freeze`."""
        rows = self.state.rows(ids)
        self.state.frozen[rows] = True
        self.state.inverse_mass[rows] = 0.0
        self.state.velocity[rows] = 0.0
        self.state.angular_velocity[rows] = 0.0
        self._bodies.set_mass(rows, np.zeros(rows.size))

    def unfreeze(self, ids: ArrayLike) -> None:
        """See `SoilEngine.unfreeze`."""
        rows = self.state.rows(ids)
        self.state.frozen[rows] = False
        self.state.inverse_mass[rows] = 1.0 / self.state.mass[rows]
        self.state.settle_timer[rows] = 0.0
        self._bodies.set_mass(rows, self.state.mass[rows])

    # Tools.

    def add_tool(
        self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose, *, is_digging: bool = True
    ) -> None:
        """See `SoilEngine.add_tool`."""
        tool = RigidTool(plates, pose, is_digging=is_digging)
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
            / max(bullet_friction(soil.repose_angle(0)), 0.1)
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
        state, params, ground, tools = self.state, self.params, self.ground, self._tools
        tools.begin_step(dt)
        for tool_id, k in tools.index_by_id.items():
            self._plates.set_pose(tool_id, tools.tools[k].start, tools.twist[k])
        proximity = find_tool_proximity(tools, state.position, 2.0 * state.radius, ground.grid.cell)
        clamp_velocities(self.clamps, dt, proximity, state.frozen, state.velocity)
        off_ground = state.frozen | proximity.shielded
        resolve_ground_contacts(
            ground.surface, ground.frame, dt, params.gravity, params.ground_friction, off_ground,
            proximity.near_digging_tool, state.position, self._bodies.quaternion, state.radius, self._bodies.contact_delta_velocity,
            self._bodies.contact_delta_angular_velocity, state.penetration_limited, state.velocity, state.angular_velocity,
        )  # fmt: skip
        self._bodies.write_to_bullet(state)
        before = state.position.copy()
        pybullet.setTimeStep(dt, physicsClientId=self._client)
        pybullet.stepSimulation(physicsClientId=self._client)
        self._bodies.read_from_bullet(state, params.gravity * dt)
        through = find_tunnelled(tools, before, state.position) & ~state.frozen
        self.num_plate_tunnellings += int(through.sum())
        self.num_ground_tunnellings += finish_ground_contacts(
            ground.surface, ground.frame, dt, params.settle_speed, off_ground, state.position,
            state.velocity, state.angular_velocity, state.radius, state.penetration_limited, state.settle_timer,
        )  # fmt: skip
        for tool_id, k in tools.index_by_id.items():
            tools.wrench[k] = self._plates.wrench(tool_id, tools.tools[k].start[1])
        tools.end_step()

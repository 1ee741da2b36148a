"""The cube engine: soil as rigid cubes in pybullet."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.soil_engine import SoilEngine
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.ground.contact_surface import Ground
from machine_sim.physics_engine import pybullet
from machine_sim.reference_cubes.cube_bodies import CubeBodies, bullet_friction
from machine_sim.reference_cubes.ground_contacts import (
    CubeView,
    ExpectedChange,
    finish_ground_contacts,
    resolve_ground_contacts,
)
from machine_sim.reference_cubes.plate_bodies import PlateBodies, find_tunnelled
from machine_sim.reference_cubes.tool_proximity import find_tool_proximity
from machine_sim.reference_cubes.velocity_clamps import VelocityClamps, clamp_velocities
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["CubeEngine"]

SOLVER_ITERATIONS = 20
"""Iterations of Bullet's contact solver; the reference leaves Unity's at 6 (section 4.2), Bullet's
own default is 50."""


class CubeEngine(SoilEngine):
    """Soil as cubes; `radii` are half edges.

    Of the parameters it uses capacity, gravity, ground_friction and those of settling, of a soil
    type friction, swell and density: the cubes of the reference have no cohesion and do not grow.
    The velocity clamps act on cubes without a reaction on the tools.

    Attributes:
        clamps: velocity clamps of the reference.
    """

    def __init__(
        self,
        params: ParticleParams,
        ground: Ground,
        *,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
        clamps: VelocityClamps | None = None,
    ) -> None:
        """Make an engine without cubes, with a pybullet client of its own.

        Args:
            params: parameters of the physics.
            ground: terrain.
            soils: all soil types of the terrain, in the order of their ids.
            clamps: velocity clamps, defaults if None.

        Raises:
            ParticleError: no soil type.
        """
        super().__init__(params, ground, soils, substeps=1)
        self.clamps = clamps or VelocityClamps()
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._disconnect = weakref.finalize(self, pybullet.disconnect, self._client)
        pybullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1,
            numSolverIterations=SOLVER_ITERATIONS,
            physicsClientId=self._client,
        )
        pybullet.setGravity(0.0, 0.0, -params.gravity, physicsClientId=self._client)
        self._bodies = CubeBodies(self._client)
        self._plates = PlateBodies(self._client)

    @property
    def is_open(self) -> bool:
        """Whether the engine has not been closed."""
        return self._disconnect.alive

    def close(self) -> None:
        """Free the pybullet client; this also happens when the engine is garbage-collected."""
        self._disconnect()

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
        """Release soil as cubes, aligned with the axes of the map; see `SoilEngine.add`.

        `grow` has no effect: cubes have their full size at once.
        """
        batch = self._validate_release(position, velocity, volume_mm3, soil, moisture)
        bank = batch.volume_mm3 * 1e-9
        half_edge = 0.5 * np.cbrt(bank * (1.0 + self._materials.swell[batch.soil]))
        mass = bank * self._materials.density[batch.soil]
        kinds = zip(batch.soil.tolist(), np.minimum(batch.moisture, 100).tolist(), strict=True)
        friction = np.array(
            [bullet_friction(self.soils[k].repose_angle(moist)) for k, moist in kinds]
        )
        ids = self.state.add(
            len(bank),
            **batch._asdict(),
            radius=half_edge,
            contact_radius=half_edge,
            mass=mass,
            inverse_mass=1.0 / mass,
            friction=friction**2,
        )
        self._bodies.add(batch.position, half_edge, mass, friction)
        return ids

    def remove(self, ids: ArrayLike) -> None:
        """Remove cubes; see `SoilEngine.remove`."""
        rows = self.state.rows(ids)
        if rows.size:
            self.state.remove(rows)
            self._bodies.remove(rows)

    def freeze(self, ids: ArrayLike) -> None:
        """Fix cubes where they are; see `SoilEngine.freeze`."""
        rows = self.state.rows(ids)
        self._freeze_rows(rows)
        self._bodies.set_mass(rows, np.zeros(rows.size))

    def unfreeze(self, ids: ArrayLike) -> None:
        """Let frozen cubes move again; see `SoilEngine.unfreeze`."""
        rows = self.state.rows(ids)
        self._unfreeze_rows(rows)
        self._bodies.set_mass(rows, self.state.mass[rows])

    # Tools.

    def _include_tool(self, tool_id: int, tool: RigidTool, plates: Sequence[ArrayLike]) -> None:
        self._plates.add(tool_id, tool, plates, self._tool_friction())

    def remove_tool(self, tool_id: int) -> None:
        """Remove a tool; see `SoilEngine.remove_tool`."""
        self._tools.remove(tool_id)
        self._plates.remove(tool_id)

    def _tool_friction(self) -> float:
        """Return the coefficient of steel for dry soil, by which Bullet multiplies the cubes'.

        It is the mean over the soil types.
        """
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
        self._validate_step(dt)
        state, ground, tools = self.state, self.ground, self._tools
        tools.begin_step(dt)
        self._place_tools()
        proximity = find_tool_proximity(tools, state.position, 2.0 * state.radius, ground.grid.cell)
        clamp_velocities(self.clamps, dt, proximity, state.frozen, state.velocity)
        skip_ground = state.frozen | proximity.ground_masked
        self._resolve_ground_contacts(dt, skip_ground, proximity.near_digging_tool)
        start = state.position.copy()
        self._step_bullet(dt)
        tunnelled = find_tunnelled(tools, start, state.position) & ~state.frozen
        self.num_plate_tunnellings += int(tunnelled.sum())
        self.num_ground_tunnellings += finish_ground_contacts(
            ground.surface, ground.frame, dt, self.params.settle_speed, skip_ground,
            CubeView.of(state), state.settle_timer,
        )  # fmt: skip
        self._read_wrenches()
        tools.end_step()

    def _place_tools(self) -> None:
        """Set the poses of the tools in pybullet, with their velocities in the step."""
        tools = self._tools
        for tool_id, k in tools.index_by_id.items():
            self._plates.set_pose(tool_id, tools.tools[k].start, tools.twist[k])

    def _resolve_ground_contacts(
        self, dt: float, skip_ground: NDArray[np.bool_], near_digging_tool: NDArray[np.bool_]
    ) -> None:
        """Change the velocities of cubes that would enter the ground in the step."""
        expected = ExpectedChange(
            self._bodies.contact_delta_velocity,
            self._bodies.contact_delta_angular_velocity,
            self.params.gravity * dt,
        )
        resolve_ground_contacts(
            self.ground.surface, self.ground.frame, dt, self.params.ground_friction, skip_ground,
            near_digging_tool, CubeView.of(self.state), self._bodies.quaternion, expected,
        )  # fmt: skip

    def _step_bullet(self, dt: float) -> None:
        """Let pybullet move the cubes."""
        self._bodies.write_to_bullet(self.state)
        pybullet.setTimeStep(dt, physicsClientId=self._client)
        pybullet.stepSimulation(physicsClientId=self._client)
        self._bodies.read_from_bullet(self.state, self.params.gravity * dt)

    def _read_wrenches(self) -> None:
        """Read the forces of the step on the tools from pybullet."""
        tools = self._tools
        for tool_id, k in tools.index_by_id.items():
            tools.wrench[k] = self._plates.wrench(tool_id, tools.tools[k].start[1])

"""The machine side: one tick moves machines, their tools, and the soil that is particles.

    release -> [drive -> carry, spill, fall -> load, resist] x steps -> settle

`MachineSim` owns some machines and the particles that they share, and knows no messages and no
clock; the exchange (`msg_bridge.exchange`) carries the rows it returns.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import ParticleEngine, ParticleParams, SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineError, TrackedMachine
from machine_sim.params import MachineSimParams
from machine_sim.physics_engine import pybullet
from machine_sim.reference_cubes import CubeEngine
from machine_sim.simulated_bin import BinSpec, SimulatedBin
from machine_sim.simulated_machine import Placement, SimulatedMachine
from machine_sim.tool_soil.coupling import ToolSoilCoupling
from machine_sim.tool_soil.payload import Payload
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import (
    DEPOSIT_REQUEST,
    MAP_UPDATE,
    SWEEP,
    ConversionKind,
    Rows,
    empty_rows,
    join_rows,
)

__all__ = ["MachineSim", "MachineTickOutput"]


@dataclass(frozen=True)
class MachineTickOutput:
    """What one tick sends to the soil; rows are not numbered yet.

    Attributes:
        sweeps: SWEEP rows of all tools and tracks.
        landed: LANDED rows; their particles are frozen until answered.
        pending_mm3, particles_mm3: the node's accounts at the end of the tick.
    """

    sweeps: Rows
    deposit_requests: Rows
    pending_mm3: int
    particles_mm3: int


_MAX_INITIAL_PENETRATION = 0.05
"""How far two things may stand in one another when they are set down [m]."""


class MachineSim:
    """Machines, the ground they feel, and the soil they move.

    Attributes:
        params: how it steps.
        ground: the copy of the terrain that tracks and particles touch.
        rigs: the machines with their tools at work, in the order given.
        bins: what stands there to be filled, in the order given.
        particles: the soil in the air, in tools and at rest but not yet landed.
        tick: number of ticks made.
    """

    def __init__(
        self,
        machines: Sequence[Placement],
        grid: Grid,
        elevation: NDArray[np.floating],
        *,
        params: MachineSimParams | None = None,
        particle_params: ParticleParams | None = None,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
        soil: NDArray[np.uint8] | None = None,
        moisture: NDArray[np.uint8] | None = None,
        bins: Sequence[BinSpec] = (),
        seed: int = 0,
    ) -> None:
        """
        Args:
            machines: what they are and where they start.
            grid, elevation: the terrain they start on [m], shape (rows, cols).
            params, particle_params: defaults as shipped.
            soils: all soils of the terrain, in the order of their ids.
            soil, moisture: of its surface, id and % of saturation; zeros if not given.
            bins: boxes that stand on it to be filled.
            seed: of the scatter of released particles.

        Raises:
            MachineError: no machine, or one or a bin off the map.
        """
        if not machines:
            raise MachineError("there is no machine; give one placement or more")
        self.params = params or MachineSimParams()
        self.ground = Ground(grid, elevation, soils=soils, soil=soil, moisture=moisture)
        self.tick = 0
        self._client: int = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(self.params.physics_step, physicsClientId=self._client)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        particle_params = particle_params or ParticleParams()
        kind = CubeEngine if particle_params.mode == "cubes" else ParticleEngine
        self.particles: SoilEngine = kind(particle_params, self.ground, soils=soils)
        self.simulated_machines: list[SimulatedMachine] = []
        for placement in machines:
            rig = SimulatedMachine(
                placement,
                self._client,
                self.ground,
                self.particles,
                self.params,
                first_tool_id=sum(rig.num_tool_ids for rig in self.simulated_machines),
                seed=seed,
            )
            self.simulated_machines.append(rig)
        num_tool_ids = sum(rig.num_tool_ids for rig in self.simulated_machines)
        self.bins = [
            SimulatedBin(spec, self._client, self.ground, self.particles, num_tool_ids + k)
            for k, spec in enumerate(bins)
        ]
        self._check_overlaps()
        self._couplings = [work for rig in self.simulated_machines for work in rig.tools.values()]
        self._cutting_couplings = [work for work in self._couplings if work.is_digging]

    @property
    def machine(self) -> TrackedMachine:
        """The first machine, of most nodes the only one."""
        return self.simulated_machines[0].machine

    @property
    def tool_coupling(self) -> ToolSoilCoupling:
        """The first tool of the first machine that has one.

        Raises:
            MachineError: none has one.
        """
        if not self._couplings:
            raise MachineError("no machine has a tool; give one with `tools` in its file")
        return self._couplings[0]

    @property
    def payload(self) -> Payload:
        """What the first machine holds."""
        return self.simulated_machines[0].payload

    @property
    def pending_mm3(self) -> int:
        """Bank volume that was excavated and is not yet particles [mm^3]."""
        return sum(work.pending.total_mm3 for work in self._cutting_couplings)

    def apply(
        self,
        conversions: Rows,
        map_updates: Rows,
        forces: Rows | None = None,
        *,
        ticks_ago: int = 0,
    ) -> None:
        """Take the soil's answer: parcels, landings made good, the new surface, the resistance.

        Args:
            conversions: CONVERSION rows of this source.
            changed: CHANGED rows.
            forces: FORCE rows of this source; none if not given.
            ticks_since: ticks done since the one that is answered, at most 3; what was cut in that
                one has moved on with the tool.
        """
        self.ground.apply_changes(map_updates)
        if forces is not None:
            for work in self._couplings:
                work.receive(forces, ticks_ago)
        if conversions.size == 0:
            return
        kind = conversions["kind"]
        self._credit_excavated_soil(conversions[kind == ConversionKind.EXCAVATE], ticks_ago)
        gone = (kind == ConversionKind.DEPOSIT) | (kind == ConversionKind.OUTSIDE)
        self.particles.remove(conversions["particle_id"][gone])
        self.particles.unfreeze(conversions["particle_id"][kind == ConversionKind.REJECT])

    def synchronize(self, keyframe: Keyframe, backlog: Rows) -> None:
        """Take part from here on: the terrain as it is now, and what was answered while away.

        Args:
            keyframe: the terrain.
            owed: CONVERSION rows of this source.
        """
        self.ground.apply_keyframe(keyframe)
        for work in self._cutting_couplings:
            work.resistance.reset()
        nothing = empty_rows(MAP_UPDATE)
        self.apply(backlog, nothing)
        # What the soil has not answered by now it has not taken: it is offered again.
        self.particles.unfreeze(self.particles.frozen_ids)

    def command(self, joints: NDArray[np.float64], tracks: NDArray[np.float64]) -> None:
        """Set the first machine's joint velocities [rad/s] and track speeds [m/s].

        They hold until the next command; zero means hold the pose.
        """
        self.machine.command(joints, tracks)

    def step(self) -> MachineTickOutput:
        """Advance one tick."""
        self.tick += 1
        dt = self.params.physics_step
        for rig in self.simulated_machines:
            rig.begin_tick(self.tick)
        for _ in range(self.params.steps_per_tick):
            self.ground.advance(dt)
            for rig in self.simulated_machines:
                rig.before_step(dt)
            pybullet.stepSimulation(self._client)
            for rig in self.simulated_machines:
                rig.after_step()
            self.particles.step(dt)
            for rig in self.simulated_machines:
                rig.apply_soil_forces(dt)
        for each in self.bins:
            each.update_payload()
        sweeps = join_rows([rig.end_tick() for rig in self.simulated_machines], SWEEP)
        deposit_requests = self._request_deposits()
        return MachineTickOutput(
            sweeps, deposit_requests, self.pending_mm3, self.particles.total_volume_mm3
        )

    def state_hash(self) -> str:
        """SHA-256 [hex] of poses and motions of machines and particles, and of pending soil."""
        particles = self.particles
        digest = hashlib.sha256()
        for array in (
            *(array for rig in self.simulated_machines for array in rig.state),
            particles.ids,
            particles.positions,
            particles.velocities,
            particles.angular_velocities,
            particles.volumes_mm3,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def close(self) -> None:
        """Free the physics clients."""
        self.particles.close()
        pybullet.disconnect(self._client)

    def _check_overlaps(self) -> None:
        """
        Raises:
            MachineError: two machines, or one and a bin, stand in one another.
        """
        pybullet.performCollisionDetection(self._client)
        standing: list[tuple[str, list[int]]] = []
        for rig in self.simulated_machines:
            x, y, _ = rig.machine.base_pose[0]
            name = f"the {rig.machine.spec.name} at ({x:.1f}, {y:.1f}) m"
            standing.append((name, [rig.machine.body]))
        standing += [(f"the bin at {each.spec.position} m", each.bodies) for each in self.bins]
        for (one, first), (other, second) in combinations(standing, 2):
            for a, b in product(first, second):
                contacts = pybullet.getContactPoints(a, b, physicsClientId=self._client)
                if any(contact[8] < -_MAX_INITIAL_PENETRATION for contact in contacts):
                    self.close()
                    raise MachineError(f"{one} and {other} stand in one another; move one away")

    def _credit_excavated_soil(self, excavated: Rows, ticks_ago: int) -> None:
        """Credit EXCAVATE rows to the tools that cut them: of several, the nearest edge's."""
        if excavated.size == 0:
            return
        if not self._cutting_couplings:
            raise MachineError("soil was excavated for machines of which none can cut")
        shares = [excavated]
        if len(self._cutting_couplings) > 1:
            places = np.column_stack([excavated[name] for name in "xyz"]).astype(np.float64)
            away = [
                work.distances_to_key_points(places, ticks_ago) for work in self._cutting_couplings
            ]
            nearest = np.argmin(away, axis=0)
            shares = [excavated[nearest == k] for k in range(len(away))]
        for work, share in zip(self._cutting_couplings, shares, strict=True):
            work.pending.receive(share, work.frame_at(ticks_ago), self.tick)

    def _request_deposits(self) -> Rows:
        """Freeze what came to rest and offer it to the soil."""
        ids = self.particles.settled()[: self.params.max_deposit_requests_per_tick]
        rows = empty_rows(DEPOSIT_REQUEST, ids.size)
        if ids.size == 0:
            return rows
        particles = self.particles
        at = self.particles.rows_of(ids)
        rows["x"], rows["y"], rows["z"] = particles.positions[at].T
        rows["volume_mm3"] = particles.volumes_mm3[at]
        rows["particle_id"] = ids
        rows["soil"], rows["moisture"] = particles.soil[at], particles.moisture[at]
        self.particles.freeze(ids)
        return rows

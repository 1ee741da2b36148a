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
import pybullet
from numpy.typing import NDArray

from machine_sim.cubes import CubeEngine
from machine_sim.ground import Ground
from machine_sim.machine import MachineError, TrackedMachine
from machine_sim.params import MachineSimParams
from machine_sim.particles import ParticleEngine, ParticleParams, SoilEngine
from machine_sim.work.bin import Bin, StandingBin
from machine_sim.work.payload import Payload
from machine_sim.work.rig import Placement, Rig
from machine_sim.work.tool_work import ToolWork
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import CHANGED, LANDED, SWEEP, Kind, Rows, empty_rows, join_rows

__all__ = ["MachineSim", "MachineStep"]


@dataclass(frozen=True)
class MachineStep:
    """What one tick sends to the soil; rows are not numbered yet.

    Attributes:
        sweeps: SWEEP rows of all tools and tracks.
        landed: LANDED rows; their particles are frozen until answered.
        pending_mm3, particles_mm3: the node's accounts at the end of the tick.
    """

    sweeps: Rows
    landed: Rows
    pending_mm3: int
    particles_mm3: int


_OVERLAP = 0.05
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
        bins: Sequence[Bin] = (),
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
        self.rigs: list[Rig] = []
        for placement in machines:
            rig = Rig(
                placement,
                self._client,
                self.ground,
                self.particles,
                self.params,
                first_number=sum(rig.numbers for rig in self.rigs),
                seed=seed,
            )
            self.rigs.append(rig)
        numbers = sum(rig.numbers for rig in self.rigs)
        self.bins = [
            StandingBin(spec, self._client, self.ground, self.particles, numbers + k)
            for k, spec in enumerate(bins)
        ]
        self._refuse_overlaps()
        self._works = [work for rig in self.rigs for work in rig.tools.values()]
        self._cutting = [work for work in self._works if work.pending is not None]

    @property
    def machine(self) -> TrackedMachine:
        """The first machine, of most nodes the only one."""
        return self.rigs[0].machine

    @property
    def tool_work(self) -> ToolWork:
        """The first tool of the first machine that has one.

        Raises:
            MachineError: none has one.
        """
        if not self._works:
            raise MachineError("no machine has a tool; give one with `tools` in its file")
        return self._works[0]

    @property
    def payload(self) -> Payload:
        """What the first machine holds."""
        return self.rigs[0].payload

    @property
    def pending_mm3(self) -> int:
        """Bank volume that was excavated and is not yet particles [mm^3]."""
        return sum(work.pending.total_mm3 for work in self._cutting if work.pending is not None)

    def apply(
        self,
        conversions: Rows,
        changed: Rows,
        forces: Rows | None = None,
        *,
        ticks_since: int = 0,
    ) -> None:
        """Take the soil's answer: parcels, landings made good, the new surface, the resistance.

        Args:
            conversions: CONVERSION rows of this source.
            changed: CHANGED rows.
            forces: FORCE rows of this source; none if not given.
            ticks_since: ticks done since the one that is answered, at most 3; what was cut in that
                one has moved on with the tool.
        """
        self.ground.follow(changed)
        if forces is not None:
            for work in self._works:
                work.hear(forces, ticks_since)
        if conversions.size == 0:
            return
        kind = conversions["kind"]
        self._receive(conversions[kind == Kind.EXCAVATE], ticks_since)
        gone = (kind == Kind.DEPOSIT) | (kind == Kind.OUTSIDE)
        self.particles.remove(conversions["particle_id"][gone])
        self.particles.unfreeze(conversions["particle_id"][kind == Kind.REFUSE])

    def enter(self, keyframe: Keyframe, owed: Rows) -> None:
        """Take part from here on: the terrain as it is now, and what was answered while away.

        Args:
            keyframe: the terrain.
            owed: CONVERSION rows of this source.
        """
        self.ground.replace(keyframe)
        for work in self._cutting:
            assert work.resistance is not None
            work.resistance.forget()
        nothing = empty_rows(CHANGED)
        self.apply(owed, nothing)
        # What the soil has not answered by now it has not taken: it is offered again.
        store = self.particles.store
        self.particles.unfreeze(store.particle_id[store.frozen])

    def command(self, joints: NDArray[np.float64], tracks: NDArray[np.float64]) -> None:
        """Set the first machine's joint velocities [rad/s] and track speeds [m/s].

        They hold until the next command; zero means hold the pose.
        """
        self.machine.command(joints, tracks)

    def step(self) -> MachineStep:
        """Advance one tick."""
        self.tick += 1
        dt = self.params.physics_step
        for rig in self.rigs:
            rig.begin_tick(self.tick)
        for _ in range(self.params.steps_per_tick):
            self.ground.advance(dt)
            for rig in self.rigs:
                rig.before_step(dt)
            pybullet.stepSimulation(self._client)
            for rig in self.rigs:
                rig.after_step()
            self.particles.step(dt)
            for rig in self.rigs:
                rig.feel(dt)
        for each in self.bins:
            each.count()
        sweeps = join_rows([rig.end_tick() for rig in self.rigs], SWEEP)
        landed = self._land()
        return MachineStep(sweeps, landed, self.pending_mm3, self.particles.total_volume_mm3)

    def state_hash(self) -> str:
        """SHA-256 [hex] of poses and motions of machines and particles, and of pending soil."""
        store = self.particles.store
        digest = hashlib.sha256()
        for array in (
            *(array for rig in self.rigs for array in rig.state),
            store.particle_id,
            store.position,
            store.velocity,
            store.spin,
            store.volume_mm3,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def close(self) -> None:
        """Free the physics clients."""
        self.particles.close()
        pybullet.disconnect(self._client)

    def _refuse_overlaps(self) -> None:
        """
        Raises:
            MachineError: two machines, or one and a bin, stand in one another.
        """
        pybullet.performCollisionDetection(self._client)
        standing: list[tuple[str, list[int]]] = []
        for rig in self.rigs:
            x, y, _ = rig.machine.base_pose[0]
            name = f"the {rig.machine.description.name} at ({x:.1f}, {y:.1f}) m"
            standing.append((name, [rig.machine.body]))
        standing += [(f"the bin at {each.spec.position} m", each.bodies) for each in self.bins]
        for (one, first), (other, second) in combinations(standing, 2):
            for a, b in product(first, second):
                contacts = pybullet.getContactPoints(a, b, physicsClientId=self._client)
                if any(contact[8] < -_OVERLAP for contact in contacts):
                    self.close()
                    raise MachineError(f"{one} and {other} stand in one another; move one away")

    def _receive(self, excavated: Rows, ticks_since: int) -> None:
        """Credit EXCAVATE rows to the tools that cut them: of several, the nearest edge's."""
        if excavated.size == 0:
            return
        if not self._cutting:
            raise MachineError("soil was excavated for machines of which none can cut")
        shares = [excavated]
        if len(self._cutting) > 1:
            places = np.column_stack([excavated[name] for name in "xyz"]).astype(np.float64)
            away = [work.distances(places, ticks_since) for work in self._cutting]
            nearest = np.argmin(away, axis=0)
            shares = [excavated[nearest == k] for k in range(len(away))]
        for work, share in zip(self._cutting, shares, strict=True):
            assert work.pending is not None
            work.pending.receive(share, work.frame_at(ticks_since), self.tick)

    def _land(self) -> Rows:
        """Freeze what came to rest and offer it to the soil."""
        ids = self.particles.settled()[: self.params.landings_per_tick]
        rows = empty_rows(LANDED, ids.size)
        if ids.size == 0:
            return rows
        store = self.particles.store
        at = self.particles.index_of(ids)
        rows["x"], rows["y"], rows["z"] = store.position[at].T
        rows["volume_mm3"] = store.volume_mm3[at]
        rows["particle_id"] = ids
        rows["soil"], rows["moisture"] = store.soil[at], store.moisture[at]
        self.particles.freeze(ids)
        return rows

"""Machine simulation: one tick moves machines, their tools, and the soil that is particles.

A tick runs these stages; the middle ones once per physics step:

    release of pending soil
    -> [machine dynamics -> particle dynamics -> soil forces on tools] x steps_per_tick
    -> payloads -> sweeps -> deposit requests

`MachineSim` owns machines and the particles that they share. It is independent of messages and
clocks; the exchange (`msg_bridge.exchange`) transports the rows.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from machine_sim.answer_check import (
    check_conversions,
    check_excavation,
    check_forces,
    check_map_updates,
)
from machine_sim.conversion_kinds import split_kind
from machine_sim.dem import ParticleEngine, ParticleParams, SoilEngine
from machine_sim.deposit_requests import request_deposits
from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineError, TrackedMachine
from machine_sim.machine_contacts import ContactMonitor
from machine_sim.overlap_check import check_overlaps
from machine_sim.params import MachineSimParams
from machine_sim.physics_engine import pybullet
from machine_sim.physics_state import PhysicsClient
from machine_sim.reference_cubes import CubeEngine
from machine_sim.simulated_bin import BinSpec, SimulatedBin
from machine_sim.simulated_machine import Placement, SimulatedMachine
from machine_sim.tool_soil.coupling import ToolSoilCoupling
from machine_sim.tool_soil.payload import Payload
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.quick_init import quick_init
from msg_bridge.contract.rows import (
    MAP_UPDATE,
    SWEEP,
    ConversionKind,
    Rows,
    empty_rows,
    join_rows,
)

__all__ = ["MachineSim", "MachineTickOutput"]

_EXCAVATE, _REJECT = int(ConversionKind.EXCAVATE), int(ConversionKind.REJECT)


@quick_init
@dataclass(frozen=True)
class MachineTickOutput:
    """Output of one tick to the soil; rows are not numbered yet.

    Attributes:
        sweeps: SWEEP rows of all tools and tracks.
        deposit_requests: DEPOSIT_REQUEST rows; their particles are frozen until answered.
        pending_mm3, particles_mm3: bank volumes at the end of the tick [mm^3].
    """

    sweeps: Rows
    deposit_requests: Rows
    pending_mm3: int
    particles_mm3: int


class MachineSim:
    """Machines, their ground, and the particles they move.

    Attributes:
        params: stepping.
        ground: copy of the terrain that tracks and particles touch.
        simulated_machines: the machines with their tools, in the order given.
        bins: the bins, in the order given.
        particles: soil in the air, in tools, and at rest before its deposition.
        contacts: contacts between machines, and of machines with bins.
        digging_couplings: the tools that hold pending soil.
        tick: number of completed ticks.
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
            machines: machines and their initial poses.
            grid, elevation: initial terrain [m], shape (rows, cols).
            params, particle_params: stepping and particles; shipped defaults if None.
            soils: all soils of the terrain, in the order of their ids.
            soil, moisture: soil id and moisture [% of saturation] of the surface; zeros if None.
            bins: bins on the terrain.
            seed: seed of the scatter of released particles.

        Raises:
            MachineError: no machine, a machine or bin off the map, or overlapping bodies.
        """
        if not machines:
            raise MachineError("no machine is given; give one placement or more")
        self.params = params or MachineSimParams()
        self.ground = Ground(grid, elevation, soils=soils, soil=soil, moisture=moisture)
        self.tick = 0
        self._physics = PhysicsClient()
        self._client = self._physics.id
        pybullet.setTimeStep(self.params.physics_step, physicsClientId=self._client)
        pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=self._client)
        particle_params = particle_params or ParticleParams()
        engine = CubeEngine if particle_params.mode == "cubes" else ParticleEngine
        self.particles: SoilEngine = engine(particle_params, self.ground, soils=soils)
        self.simulated_machines: list[SimulatedMachine] = []
        self._num_tool_ids = 0
        for placement in machines:
            simulated_machine = SimulatedMachine(
                placement,
                self._client,
                self.ground,
                self.particles,
                self.params,
                first_tool_id=self._num_tool_ids,
                seed=seed,
            )
            self.simulated_machines.append(simulated_machine)
            self._num_tool_ids += simulated_machine.num_tool_ids
        self.bins = [
            SimulatedBin(spec, self._client, self.ground, self.particles, self._num_tool_ids + k)
            for k, spec in enumerate(bins)
        ]
        check_overlaps(self._client, [each.machine for each in self.simulated_machines], self.bins)
        self.contacts = ContactMonitor(
            self._client,
            [each.machine.body for each in self.simulated_machines],
            [each.bodies for each in self.bins],
        )
        self._time = 0.0  # of the last physics step [s]
        self._couplings = [
            coupling for each in self.simulated_machines for coupling in each.couplings.values()
        ]
        self.digging_couplings = [each for each in self._couplings if each.is_digging]

    def continue_from(self, other: MachineSim) -> None:
        """Take the state of a simulation of the same machines with other parameters.

        The volumes are exact; forces of contacts start at zero.

        Raises:
            MachineError: other machines, joints or tools, dynamic tracks, or cubes as particles.
            ParticleError: more particles than the capacity.
        """
        if len(self.simulated_machines) != len(other.simulated_machines):
            raise MachineError(
                f"the state is of {len(other.simulated_machines)} machines, and"
                f" {len(self.simulated_machines)} are given; give as many"
            )
        particles, before = self.particles, other.particles
        if not (isinstance(particles, ParticleEngine) and isinstance(before, ParticleEngine)):
            raise MachineError("a state of cubes has no particles; keep particles.mode at spheres")
        for each, previous in zip(self.simulated_machines, other.simulated_machines, strict=True):
            each.continue_from(previous)
        self.ground.continue_from(other.ground)
        particles.continue_from(before)
        self.tick, self._time = other.tick, other._time

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the bodies, for a saved state; `take_bodies` before it is used again."""
        return {name: each for name, each in vars(self).items() if name != "_physics"}

    def take_bodies(self, made: MachineSim) -> None:
        """Use the bodies that were made for this saved state, in a client of its id.

        Args:
            made: a simulation of the same machines; it must not be stepped any more.
        """
        self._physics = made._physics

    @property
    def machine(self) -> TrackedMachine:
        """The first machine, in most nodes the only one."""
        return self.simulated_machines[0].machine

    @property
    def tool_coupling(self) -> ToolSoilCoupling:
        """The first tool of the first machine that has one.

        Raises:
            MachineError: no machine has a tool.
        """
        if not self._couplings:
            raise MachineError("no machine has a tool; give one with `tools` in its file")
        return self._couplings[0]

    @property
    def payload(self) -> Payload:
        """Payload of the first machine."""
        return self.simulated_machines[0].payload

    @property
    def pending_mm3(self) -> int:
        """Bank volume that was excavated and is not yet particles [mm^3]."""
        return sum(each.pending.total_mm3 for each in self.digging_couplings)

    def check_answer(
        self, conversions: Rows, map_updates: Rows, forces: Rows, *, ticks_ago: int = 0
    ) -> None:
        """Check the soil's answer to a tick; `apply` cannot fail with a valid one.

        Args:
            conversions, map_updates, forces, ticks_ago: as for `apply`.

        Raises:
            ExchangeError: VALUE, OFF_MAP, PARTICLE or EXCAVATION.
        """
        check_map_updates(map_updates, self.ground)
        check_forces(forces, self._num_tool_ids)
        self._check_conversions(conversions)
        if self.digging_couplings:
            check_excavation(conversions, self.ground, self.digging_couplings, ticks_ago)

    def apply(
        self,
        conversions: Rows,
        map_updates: Rows,
        forces: Rows | None = None,
        *,
        ticks_ago: int = 0,
    ) -> None:
        """Apply the soil's answer to a tick.

        Args:
            conversions: CONVERSION rows of this node: excavated soil and answered deposits.
            map_updates: MAP_UPDATE rows: the changed surface.
            forces: FORCE rows of this node; None for none.
            ticks_ago: number of ticks completed since the answered one, at most 3; the soil cut in
                that tick has moved with the tool since then.
        """
        self.ground.apply_changes(map_updates)
        if forces is not None:
            for coupling in self._couplings:
                coupling.receive(forces, ticks_ago)
        if conversions.size == 0:
            return
        excavated, answers = split_kind(conversions, _EXCAVATE)
        rejected, deposited = split_kind(answers, _REJECT)
        self.credit_excavated_soil(excavated, ticks_ago)
        if deposited.size:
            self.particles.remove(deposited["particle_id"])
        if rejected.size:
            self.particles.unfreeze(rejected["particle_id"])

    def synchronize(self, keyframe: Keyframe, backlog: Rows) -> None:
        """Apply the present terrain and the conversion backlog after a join or rejoin.

        Args:
            keyframe: present terrain.
            backlog: CONVERSION rows of this node since its last completed tick.

        Raises:
            ExchangeError: VALUE, OFF_MAP or PARTICLE: an invalid backlog; nothing was changed.
        """
        self._check_conversions(backlog)
        self.ground.apply_keyframe(keyframe)
        for coupling in self.digging_couplings:
            coupling.reset()
        self.apply(backlog, empty_rows(MAP_UPDATE))
        # The soil did not accept deposit requests without an answer: they are repeated.
        self.particles.unfreeze(self.particles.frozen_ids)

    def discard_soil(self) -> int:
        """Remove all particles and pending soil; return their bank volume [mm^3].

        For soil that the terrain does not count as this node's any more.
        """
        volume = self.pending_mm3 + self.particles.total_volume_mm3
        for coupling in self.digging_couplings:
            coupling.pending.clear()
        self.particles.remove(self.particles.ids.copy())
        return volume

    def command(self, joints: NDArray[np.float64], tracks: NDArray[np.float64]) -> None:
        """Set the first machine's joint velocities [rad/s] and track speeds [m/s].

        They apply until the next command; zero holds the pose.
        """
        self.machine.command(joints, tracks)

    def step(self) -> MachineTickOutput:
        """Perform one tick."""
        self.tick += 1
        dt = self.params.physics_step
        for each in self.simulated_machines:
            each.begin_tick(self.tick)
        for _ in range(self.params.steps_per_tick):
            self.ground.advance(dt)
            for each in self.simulated_machines:
                each.before_step(dt)
            pybullet.stepSimulation(self._client)
            for each in self.simulated_machines:
                each.after_step()
            self._time += dt
            self.contacts.update(self._time)
            self.particles.step(dt)
            for each in self.simulated_machines:
                each.apply_soil_forces(dt)
        for simulated_bin in self.bins:
            simulated_bin.update_payload()
        sweeps = join_rows(
            [rows for each in self.simulated_machines for rows in each.end_tick()], SWEEP
        )
        max_requests = self.params.max_deposit_requests_per_tick
        deposit_requests = request_deposits(self.particles, max_requests)
        return MachineTickOutput(
            sweeps, deposit_requests, self.pending_mm3, self.particles.total_volume_mm3
        )

    def state_hash(self) -> str:
        """Return the SHA-256 [hex] of the state of machines, pending soil and particles."""
        particles = self.particles
        digest = hashlib.sha256()
        for array in (
            *(array for each in self.simulated_machines for array in each.state),
            particles.ids,
            particles.positions,
            particles.velocities,
            particles.angular_velocities,
            particles.volumes_mm3,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def close(self) -> None:
        """Release the memory of the physics engine at once, not when the object is collected."""
        self.particles.close()
        self._physics.close()

    def _check_conversions(self, conversions: Rows) -> None:
        check_conversions(
            conversions, self.ground, self.particles, can_dig=bool(self.digging_couplings)
        )

    def credit_excavated_soil(self, excavated: Rows, ticks_ago: int) -> None:
        """Credit EXCAVATE rows to the digging tool whose key points are nearest.

        There is a digging tool if there are rows: `check_conversions` has checked it.
        """
        if excavated.size == 0:
            return
        rows_of_tools = [excavated]
        if len(self.digging_couplings) > 1:
            points = np.column_stack([excavated[name] for name in "xyz"]).astype(np.float64)
            distances = [
                each.distances_to_key_points(points, ticks_ago) for each in self.digging_couplings
            ]
            nearest = np.argmin(distances, axis=0)
            rows_of_tools = [excavated[nearest == k] for k in range(len(distances))]
        for coupling, rows in zip(self.digging_couplings, rows_of_tools, strict=True):
            if rows.size:
                coupling.pending.receive(rows, coupling.frame_at(ticks_ago), self.tick)

"""The machine side: one tick moves the machine, its tool, and the soil that is particles.

    release -> [drive -> carry, spill, fall -> load, resist] x steps -> settle

`MachineSim` owns a machine and its particles and knows no messages and no clock; the exchange
(`msg_bridge.exchange`) carries the rows it returns.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pybullet
from numpy.typing import NDArray

from machine_sim.cubes import CubeEngine
from machine_sim.ground import Ground
from machine_sim.machine import Excavator, MachineDescription
from machine_sim.machine.kinematics import rotation_matrix
from machine_sim.machine.tracks import sole_heights
from machine_sim.params import MachineSimParams
from machine_sim.particles import ParticleEngine, ParticleParams, Pose, SoilEngine
from machine_sim.payload import payload_in
from machine_sim.release import PendingSoil
from machine_sim.resistance import Resistance
from machine_sim.sweep import sweep_rows, track_rows
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import CHANGED, LANDED, SWEEP, Kind, Rows, empty_rows, join_rows

__all__ = ["MachineSim", "MachineStep"]

_TOOL = 0

_POSES = 4
"""Poses of the tool at the ends of ticks that are remembered."""


@dataclass(frozen=True)
class MachineStep:
    """What one tick sends to the soil; rows are not numbered yet.

    Attributes:
        sweeps: SWEEP rows of the tool and the tracks.
        landed: LANDED rows; their particles are frozen until answered.
        pending_mm3, particles_mm3: the machine's accounts at the end of the tick.
    """

    sweeps: Rows
    landed: Rows
    pending_mm3: int
    particles_mm3: int


class MachineSim:
    """One excavator, the ground it feels, and the soil it moves.

    Attributes:
        params: how it steps.
        ground: the copy of the terrain that tracks and particles touch.
        machine: the excavator.
        particles: the soil in the air, in the tool and at rest but not yet landed.
        pending: soil excavated and not yet particles.
        resistance: the soil that the tool cuts.
        tick: number of ticks made.
        payload: soil in the bucket at the end of the last tick.
    """

    def __init__(
        self,
        description: MachineDescription,
        grid: Grid,
        elevation: NDArray[np.floating],
        *,
        params: MachineSimParams | None = None,
        particle_params: ParticleParams | None = None,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
        soil: NDArray[np.uint8] | None = None,
        moisture: NDArray[np.uint8] | None = None,
        position: tuple[float, float] = (0.0, 0.0),
        yaw: float = 0.0,
        seed: int = 0,
    ) -> None:
        """
        Args:
            description: dimensions, masses and limits of the machine.
            grid, elevation: the terrain it starts on [m], shape (rows, cols).
            params, particle_params: defaults as shipped.
            soils: all soils of the terrain, in the order of their ids.
            soil, moisture: of its surface, id and % of saturation; zeros if not given.
            position: where it starts (x, y) [m], map frame; it is set down on the ground.
            yaw: where it faces [rad], from +x counter-clockwise.
            seed: of the scatter of released particles.
        """
        self.params = params or MachineSimParams()
        self.ground = Ground(grid, elevation, soils=soils, soil=soil, moisture=moisture)
        self.tick = 0
        self._client: int = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(self.params.physics_step, physicsClientId=self._client)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        self.machine = Excavator(
            description, self._client, self.ground, position, yaw, self.params.tracks
        )
        particle_params = particle_params or ParticleParams()
        kind = CubeEngine if particle_params.mode == "cubes" else ParticleEngine
        self.particles: SoilEngine = kind(particle_params, self.ground, soils=soils)
        self._bucket, self._tracks = description.bucket, description.tracks
        self.particles.add_tool(_TOOL, self._bucket.plates(), self.machine.tool_pose)
        self.payload = payload_in(self._bucket, self.particles, _TOOL)
        masses = {name: link.mass for name, link in description.links.items()}
        self.resistance = Resistance(
            masses["bucket"], sum(masses.values()), self.params.physics_step
        )
        self._resisted = (np.zeros(3), np.zeros(3))
        self._tool_poses = deque([self.machine.tool_pose], maxlen=_POSES)
        self.pending = PendingSoil(
            self._bucket,
            np.random.default_rng(seed),
            nominal_mm3=self.particles.params.nominal_volume,
            per_tick=self.params.release_per_tick,
        )

    @property
    def tool_wrench(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the soil on the tool and torque about its frame's origin [N m], map axes.

        The load in the tool and what resists its cut, as of the end of the last step.
        """
        force, torque = self.particles.tool_wrench(_TOOL)
        return force + self._resisted[0], torque + self._resisted[1]

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
        cut_at = self._tool_poses[max(-1 - ticks_since, -len(self._tool_poses))]
        self.pending.receive(conversions, cut_at, self.tick)
        if forces is not None:
            own = forces[forces["tool"] == _TOOL]
            if own.size:
                self.resistance.hear(own, cut_at)
        kind = conversions["kind"]
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
        self.resistance.forget()
        nothing = empty_rows(CHANGED)
        self.apply(owed, nothing)
        # What the soil has not answered by now it has not taken: it is offered again.
        store = self.particles.store
        self.particles.unfreeze(store.particle_id[store.frozen])

    def command(self, joints: NDArray[np.float64], tracks: NDArray[np.float64]) -> None:
        """Set joint velocities [rad/s] (swing, boom, arm, bucket) and track speeds [m/s].

        They hold until the next command; zero means hold the pose.
        """
        self.machine.command(joints, tracks)

    def step(self) -> MachineStep:
        """Advance one tick."""
        self.tick += 1
        dt = self.params.physics_step
        start, standing = self.machine.tool_pose, self._base
        self.resistance.tick()
        self.pending.release(self.particles, start, self.tick)
        for _ in range(self.params.steps_per_tick):
            before = self.machine.tool_pose
            self.ground.advance(dt)
            self.machine.before_step(dt)
            pybullet.stepSimulation(self._client)
            self.machine.after_step()
            self.particles.set_tool(_TOOL, before, self.machine.tool_pose)
            self.particles.step(dt)
            if self.params.load_acts:
                self.machine.apply_tool_wrench(*self.particles.tool_wrench(_TOOL))
            if self.params.cutting_acts:
                self._resist(dt)
        self._tool_poses.append(self.machine.tool_pose)
        self.payload = payload_in(self._bucket, self.particles, _TOOL)
        tool = sweep_rows(self._bucket, start, self.machine.tool_pose, tool=_TOOL)
        soles = sole_heights(self.machine.tracks)
        tracks = track_rows(self._tracks, standing, self._base, first_tool=_TOOL + 1, soles=soles)
        landed = self._land()
        sweeps = join_rows([tool, tracks], SWEEP)
        return MachineStep(sweeps, landed, self.pending.total_mm3, self.particles.total_volume_mm3)

    @property
    def _base(self) -> Pose:
        """Pose of the base frame: base to map, and its origin [m]."""
        position, quaternion = self.machine.base_pose
        return rotation_matrix(quaternion), position

    def state_hash(self) -> str:
        """SHA-256 [hex] of the machine's pose and motion, its particles and its pending soil."""
        machine, store = self.machine, self.particles.store
        digest = hashlib.sha256()
        for array in (
            machine.joint_positions,
            machine.joint_velocities,
            *machine.base_pose,
            *machine.base_velocity,
            store.particle_id,
            store.position,
            store.velocity,
            store.spin,
            store.volume_mm3,
            np.array([self.pending.total_mm3]),
            self.resistance.state,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def close(self) -> None:
        """Free the physics clients."""
        self.particles.close()
        pybullet.disconnect(self._client)

    def _resist(self, dt: float) -> None:
        """Let the soil that the tool cuts and stands on act in the next physics step."""
        machine = self.machine
        self._resisted = self.resistance.step(machine.tool_pose, machine.tool_velocity, dt)
        if self.resistance.holds:
            machine.apply_tool_wrench(*self._resisted)

    def _land(self) -> Rows:
        """Freeze what came to rest and offer it to the soil."""
        ids = self.particles.settled()[: self.params.landings_per_tick]
        rows = empty_rows(LANDED, ids.size)
        if ids.size:
            store = self.particles.store
            at = self.particles.index_of(ids)
            rows["x"], rows["y"], rows["z"] = store.position[at].T
            rows["volume_mm3"] = store.volume_mm3[at]
            rows["particle_id"] = ids
            rows["soil"], rows["moisture"] = store.soil[at], store.moisture[at]
            self.particles.freeze(ids)
        return rows

"""Whether the machine stays sound while it drives and digs about at random on rough ground.

A careless operator works on rolling ground: it drives straight, round bends and on the spot, digs
with all joints, drives while it digs, and falls into what it dug. All it is careful about is not to
fall over: once the machine leans far, it stops and lifts the boom, or puts its load down. Prints a
line a run: how long it lasted and why it ended, for how long it was stuck, and whether the volume
always balanced. Run from the repository root: `python benchmarks/random_digging.py`;
`--minutes 10` for the long proof, 40 minutes for three seeds on tracks of either kind.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.world import World
from machine_sim.machine import MachineError, load_machine_spec, rotation_matrix
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

Array = NDArray[np.float64]

GRID = Grid(257, 257, 0.2)

MAX_DISTANCE_FROM_CENTRE = 16.0
"""Furthest from the middle of the map that it drives away from it [m]."""

STOP_TILT, RESUME_TILT = 0.35, 0.2
"""Tilt [rad] at which the operator lets go, and at which it goes on."""

FREE_TOOL_FORCE = 20e3
"""Soil that holds the tool with less than this leaves the machine free to drive [N]."""

STUCK_DISTANCE = 0.5
"""A machine that got this far is not stuck [m]."""

TRACK_SPEEDS = (
    (0.8, 0.8),
    (-0.8, -0.8),
    (0.6, 0.2),
    (0.2, 0.6),
    (-0.4, 0.4),
    (0.4, -0.4),
    (1.2, 1.2),
)
"""Track speeds [m/s]."""

MAX_JOINT_SPEEDS = np.array([0.5, 0.35, 0.7, 0.9])
"""Greatest speeds of swing, boom, arm and bucket while digging [rad/s]."""

LIFT_VELOCITIES = np.array([0.0, -0.4, 0.0, 0.0])
"""Joint speeds that lift the arm off the ground [rad/s]."""


@dataclass
class DrivingOutcome:
    """How a run went.

    Attributes:
        seconds: simulated, until it ended or went wrong.
        problem: what went wrong, empty if nothing.
        leaned: how often the operator had to let go.
        way: gone [m].
        moved: soil that was in the bucket at once, the most [m^3].
        stuck: longest time that it was told to drive, was free, and did not get `GONE` far [s].
        imbalance: the worst of all ticks [mm^3].
        particles: the most at once.
        wall: time it took [s].
    """

    seconds: float = 0.0
    problem: str = ""
    num_tilt_stops: int = 0
    distance: float = 0.0
    moved: float = 0.0
    max_stuck_time: float = 0.0
    imbalance: int = 0
    particles: int = 0
    wall: float = 0.0


def rolling_ground(seed: int) -> Array:
    """Heights of ground of 14 random waves [m], 0.3 m high in all."""
    rng = np.random.default_rng(seed)
    across = np.arange(GRID.rows)
    x, y = np.meshgrid(GRID.x(across), GRID.y(across), indexing="ij")
    heights = np.zeros(GRID.shape)
    for _ in range(14):
        kx, ky, phase = *rng.normal(0.0, 0.6, 2), rng.uniform(0.0, 2.0 * math.pi)
        heights += 0.1 * np.sin(kx * x + ky * y + phase) / (1.0 + 1.2 * math.hypot(kx, ky))
    return heights


def place_machine(soil: Soil, model: TrackModel, seed: int) -> MachineSim:
    """The machine that digs, in the middle of the map."""
    return MachineSim(
        [Placement(load_machine_spec(find_config("machines/excavator.yaml")))],
        GRID,
        soil.columns.height,
        soil=soil.columns.top_soil,
        moisture=soil.columns.top_moisture,
        params=MachineSimParams(track_model=model),
        soils=soil.loose_soils,
        seed=seed,
    )


class RandomOperator:
    """The operator, and the world it is let loose on.

    Attributes:
        outcome: how it went so far.
    """

    def __init__(self, model: TrackModel, seed: int, soil: str = "loam") -> None:
        ground = Soil(GRID, rolling_ground(seed), SoilParams(soil=soil))
        self.sim = place_machine(ground, model, seed)
        self.world = World(ground, {1: self.sim})
        self.outcome = DrivingOutcome()
        self._rng = np.random.default_rng(seed)
        self._last_position = self.sim.machine.base_pose[0]
        self._stuck_reference = self._last_position  # where it was when it last got somewhere
        self._stuck_time = 0.0  # for how long it has tried to get away from there [s]

    def run(self, seconds: float) -> DrivingOutcome:
        """Work for that long, or until something goes wrong."""
        began, outcome = time.perf_counter(), self.outcome
        try:
            while outcome.seconds < seconds and not outcome.problem:
                self._perform_action()
        except MachineError as error:
            outcome.problem = str(error)
        outcome.wall = time.perf_counter() - began
        return outcome

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def _perform_action(self) -> None:
        """Do one thing for one to four seconds."""
        kind, lasts = self._rng.integers(4), self._rng.uniform(1.0, 4.0)
        digs, drives = kind > 0, kind < 2
        joints = self._rng.uniform(-1.0, 1.0, 4) * MAX_JOINT_SPEEDS if digs else LIFT_VELOCITIES
        self._hold_command(joints, self._choose_track_speeds() if drives else (0.0, 0.0), lasts)
        if self.sim.machine.tilt > STOP_TILT:
            self._recover_from_tilt()

    def _choose_track_speeds(self) -> tuple[float, float]:
        """Track speeds [m/s]: any, or back toward the middle of the map."""
        tracks = TRACK_SPEEDS[self._rng.integers(len(TRACK_SPEEDS))]
        place, quaternion = self.sim.machine.base_pose
        if np.hypot(*place[:2]) > MAX_DISTANCE_FROM_CENTRE:
            back = -0.8 if place @ rotation_matrix(quaternion)[:, 0] > 0.0 else 0.8
            tracks = (back, back)
        return tracks

    def _recover_from_tilt(self) -> None:
        """Stop and give way with the boom until the machine is upright again."""
        self.outcome.num_tilt_stops += 1
        for _ in range(40):
            self._hold_command(
                -LIFT_VELOCITIES if self._is_tipped_by_arm_load() else LIFT_VELOCITIES,
                (0.0, 0.0),
                0.5,
            )
            if self.sim.machine.tilt < RESUME_TILT or self.outcome.problem:
                break

    def _is_tipped_by_arm_load(self) -> bool:
        """Whether the load on the arm tips the machine, rather than the arm that props it up."""
        machine = self.sim.machine
        place, quaternion = machine.base_pose
        reach = machine.tool.pose[1] - place
        return bool(rotation_matrix(quaternion)[:2, 2] @ reach[:2] > 0.0)

    def _hold_command(self, joints: Array, tracks: tuple[float, float], seconds: float) -> None:
        """Hold a command until the time is over or the machine leans."""
        self.sim.command(joints, np.array(tracks))
        num_tilt_stops = self.sim.machine.tilt > STOP_TILT
        for _ in range(round(seconds / self.sim.params.tick_period)):
            self._step(drives=tracks[0] * tracks[1] > 0.0)
            if self.outcome.problem or (self.sim.machine.tilt > STOP_TILT and not num_tilt_stops):
                break

    def _step(self, *, drives: bool) -> None:
        outcome, machine, tick = self.outcome, self.sim.machine, self.sim.params.tick_period
        ledger = self.world.step()
        outcome.seconds += tick
        outcome.imbalance = max(outcome.imbalance, ledger.imbalance, key=abs)
        outcome.particles = max(outcome.particles, self.sim.particles.count)
        outcome.moved = max(outcome.moved, self.sim.payload.bank_m3)
        place = machine.base_pose[0]
        outcome.distance += float(np.linalg.norm(place - self._last_position))
        self._last_position = place
        if np.linalg.norm(place - self._stuck_reference) > STUCK_DISTANCE:
            self._stuck_reference, self._stuck_time = place, 0.0
        elif drives and np.linalg.norm(self.sim.tool_coupling.wrench[0]) < FREE_TOOL_FORCE:
            self._stuck_time += tick
            outcome.max_stuck_time = max(outcome.max_stuck_time, self._stuck_time)
        if machine.overturned:
            outcome.problem = "it fell over"
        elif not np.isfinite([*place, *machine.joint_positions]).all():
            outcome.problem = "its state is not finite"
        elif np.linalg.norm(machine.base_velocity[0]) > 10.0:
            outcome.problem = "it was thrown"


def main() -> None:
    """Print a line a run."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--model", choices=TRACK_MODELS, help="only this one")
    parser.add_argument("--minutes", type=float, default=1.0, help="simulated, of each run")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--soil", default="loam", help="a name in config/soils.yaml")
    asked = parser.parse_args()
    for model in (asked.model,) if asked.model else TRACK_MODELS:
        for seed in asked.seeds:
            operator = RandomOperator(model, seed, asked.soil)
            did = operator.run(60.0 * asked.minutes)
            operator.close()
            print(
                f"{model:<8} seed {seed}: {did.seconds:5.0f} s,"
                f" {did.problem or 'sound'}; {did.distance:.0f} m, stuck for"
                f" {did.max_stuck_time:.1f} s at most,"
                f" {did.moved:.2f} m3 in the bucket, {did.particles} particles, leaned"
                f" {did.num_tilt_stops} times, imbalance {did.imbalance} mm3,"
                f" {did.seconds / did.wall:.1f} x real time",
                flush=True,
            )


if __name__ == "__main__":
    main()

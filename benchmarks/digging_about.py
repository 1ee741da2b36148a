"""Whether the machine stays sound while it drives and digs about at random on rough ground.

A careless operator works on rolling ground: it drives straight, round bends and on the spot, digs
with all joints, drives while it digs, and falls into what it dug. All it is careful about is not to
fall over: once the machine leans far, it stops and lifts the boom, or puts its load down. Prints a
line a run: how long it lasted and why it ended, for how long it was stuck, and whether the volume
always balanced. Run from the repository root: `python benchmarks/digging_about.py`;
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
from machine_sim.core import MachineSim
from machine_sim.machine import MachineError, load_description, rotation_matrix
from machine_sim.machine.tracks.model import TRACK_MODELS, TrackModel
from machine_sim.params import MachineSimParams
from machine_sim.work.rig import Placement
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.params import SoilParams
from soil_sim.soil import Soil

Array = NDArray[np.float64]

GRID = Grid(257, 257, 0.2)

ROOM = 16.0
"""Furthest from the middle of the map that it drives away from it [m]."""

LEANS, UPRIGHT = 0.35, 0.2
"""Tilt [rad] at which the operator lets go, and at which it goes on."""

FREE = 20e3
"""Soil that holds the tool with less than this leaves the machine free to drive [N]."""

GONE = 0.5
"""A machine that got this far is not stuck [m]."""

DRIVES = ((0.8, 0.8), (-0.8, -0.8), (0.6, 0.2), (0.2, 0.6), (-0.4, 0.4), (0.4, -0.4), (1.2, 1.2))
"""Track speeds [m/s]."""

JOINTS = np.array([0.5, 0.35, 0.7, 0.9])
"""Greatest speeds of swing, boom, arm and bucket while digging [rad/s]."""

LIFTED = np.array([0.0, -0.4, 0.0, 0.0])
"""Joint speeds that lift the arm off the ground [rad/s]."""


@dataclass
class Outcome:
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
    leaned: int = 0
    way: float = 0.0
    moved: float = 0.0
    stuck: float = 0.0
    imbalance: int = 0
    particles: int = 0
    wall: float = 0.0


def rolling(seed: int) -> Array:
    """Heights of ground of 14 random waves [m], 0.3 m high in all."""
    rng = np.random.default_rng(seed)
    across = np.arange(GRID.rows)
    x, y = np.meshgrid(GRID.x(across), GRID.y(across), indexing="ij")
    heights = np.zeros(GRID.shape)
    for _ in range(14):
        kx, ky, phase = *rng.normal(0.0, 0.6, 2), rng.uniform(0.0, 2.0 * math.pi)
        heights += 0.1 * np.sin(kx * x + ky * y + phase) / (1.0 + 1.2 * math.hypot(kx, ky))
    return heights


def machine_on(soil: Soil, model: TrackModel, seed: int) -> MachineSim:
    """The machine that digs, in the middle of the map."""
    return MachineSim(
        [Placement(load_description(find_config("machines/excavator.yaml")))],
        GRID,
        soil.columns.height,
        soil=soil.columns.top_soil,
        moisture=soil.columns.top_moisture,
        params=MachineSimParams(tracks=model),
        soils=soil.loose_soils,
        seed=seed,
    )


class Careless:
    """The operator, and the world it is let loose on.

    Attributes:
        outcome: how it went so far.
    """

    def __init__(self, model: TrackModel, seed: int, soil: str = "loam") -> None:
        ground = Soil(GRID, rolling(seed), SoilParams(soil=soil))
        self.sim = machine_on(ground, model, seed)
        self.world = World(ground, {1: self.sim})
        self.outcome = Outcome()
        self._rng = np.random.default_rng(seed)
        self._place = self.sim.machine.base_pose[0]
        self._left = self._place  # where it was when it last got somewhere
        self._tried = 0.0  # for how long it has tried to get away from there [s]

    def run(self, seconds: float) -> Outcome:
        """Work for that long, or until something goes wrong."""
        began, outcome = time.perf_counter(), self.outcome
        try:
            while outcome.seconds < seconds and not outcome.problem:
                self._act()
        except MachineError as error:
            outcome.problem = str(error)
        outcome.wall = time.perf_counter() - began
        return outcome

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def _act(self) -> None:
        """Do one thing for one to four seconds."""
        kind, lasts = self._rng.integers(4), self._rng.uniform(1.0, 4.0)
        digs, drives = kind > 0, kind < 2
        joints = self._rng.uniform(-1.0, 1.0, 4) * JOINTS if digs else LIFTED
        self._hold(joints, self._way_to_drive() if drives else (0.0, 0.0), lasts)
        if self.sim.machine.tilt > LEANS:
            self._let_go()

    def _way_to_drive(self) -> tuple[float, float]:
        """Track speeds [m/s]: any, or back toward the middle of the map."""
        tracks = DRIVES[self._rng.integers(len(DRIVES))]
        place, quaternion = self.sim.machine.base_pose
        if np.hypot(*place[:2]) > ROOM:
            back = -0.8 if place @ rotation_matrix(quaternion)[:, 0] > 0.0 else 0.8
            tracks = (back, back)
        return tracks

    def _let_go(self) -> None:
        """Stop and give way with the boom until the machine is upright again."""
        self.outcome.leaned += 1
        for _ in range(40):
            self._hold(-LIFTED if self._leans_on_its_arm() else LIFTED, (0.0, 0.0), 0.5)
            if self.sim.machine.tilt < UPRIGHT or self.outcome.problem:
                break

    def _leans_on_its_arm(self) -> bool:
        """Whether the load on the arm tips the machine, rather than the arm that props it up."""
        machine = self.sim.machine
        place, quaternion = machine.base_pose
        reach = machine.tool.pose[1] - place
        return bool(rotation_matrix(quaternion)[:2, 2] @ reach[:2] > 0.0)

    def _hold(self, joints: Array, tracks: tuple[float, float], seconds: float) -> None:
        """Hold a command until the time is over or the machine leans."""
        self.sim.command(joints, np.array(tracks))
        leaned = self.sim.machine.tilt > LEANS
        for _ in range(round(seconds / self.sim.params.tick)):
            self._step(drives=tracks[0] * tracks[1] > 0.0)
            if self.outcome.problem or (self.sim.machine.tilt > LEANS and not leaned):
                break

    def _step(self, *, drives: bool) -> None:
        outcome, machine, tick = self.outcome, self.sim.machine, self.sim.params.tick
        ledger = self.world.step()
        outcome.seconds += tick
        outcome.imbalance = max(outcome.imbalance, ledger.imbalance, key=abs)
        outcome.particles = max(outcome.particles, self.sim.particles.count)
        outcome.moved = max(outcome.moved, self.sim.payload.bank)
        place = machine.base_pose[0]
        outcome.way += float(np.linalg.norm(place - self._place))
        self._place = place
        if np.linalg.norm(place - self._left) > GONE:
            self._left, self._tried = place, 0.0
        elif drives and np.linalg.norm(self.sim.tool_work.wrench[0]) < FREE:
            self._tried += tick
            outcome.stuck = max(outcome.stuck, self._tried)
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
            operator = Careless(model, seed, asked.soil)
            did = operator.run(60.0 * asked.minutes)
            operator.close()
            print(
                f"{model:<8} seed {seed}: {did.seconds:5.0f} s,"
                f" {did.problem or 'sound'}; {did.way:.0f} m, stuck for {did.stuck:.1f} s at most,"
                f" {did.moved:.2f} m3 in the bucket, {did.particles} particles, leaned"
                f" {did.leaned} times, imbalance {did.imbalance} mm3,"
                f" {did.seconds / did.wall:.1f} x real time",
                flush=True,
            )


if __name__ == "__main__":
    main()

"""Test the excavator with random driving and digging on rough ground.

    python -m benchmarks.random_digging                # one minute for each seed and track model
    python -m benchmarks.random_digging --minutes 10   # about 40 minutes of wall-clock time
    python -m benchmarks.random_digging --drive-only --model dynamic --minutes 30

An operator gives random commands on rolling ground: the machine drives straight, in curves and on
the spot, digs with all joints, drives while it digs, and drives into its own pits. The operator
only avoids overturning: when the machine tilts too far, it stops and raises the boom, or lowers
its load. With `--drive-only` it drives at up to the maximum speed, brakes and reverses at once, and
keeps the arm folded, on waves of 0.4 m for every other seed. Prints a row for each run: why and
when it ended, the longest time stuck, how often a track came off its wheels, the volume imbalance,
and the speed.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
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
"""Distance from the middle of the map beyond which the machine drives back [m]."""

STOP_TILT, RESUME_TILT = 0.35, 0.2
"""Tilt [rad] at which the operator stops, and below which it continues."""

FREE_TOOL_FORCE = 20e3
"""Force on the tool below which the machine is free to drive [N]."""

STUCK_DISTANCE = 0.5
"""Distance after which a machine is not stuck [m]."""

MAX_SPEED = 10.0
"""Base speed above which a run counts as failed [m/s]."""

TRACK_SPEEDS = (
    (0.8, 0.8),
    (-0.8, -0.8),
    (0.6, 0.2),
    (0.2, 0.6),
    (-0.4, 0.4),
    (0.4, -0.4),
    (1.2, 1.2),
)
"""Left and right track speeds [m/s] of which the operator chooses."""

MAX_JOINT_SPEEDS = np.array([0.5, 0.35, 0.7, 0.9])
"""Maximum speeds of swing, boom, arm and bucket while digging [rad/s]."""

LIFT_VELOCITIES = np.array([0.0, -0.4, 0.0, 0.0])
"""Joint velocities that raise the boom [rad/s]."""


@dataclass
class DrivingOutcome:
    """Result of a run.

    Attributes:
        seconds: simulated time until the run ended or failed [s].
        problem: why the run failed; empty if it did not.
        num_tilt_stops: number of times the operator stopped because of the tilt.
        distance: distance driven [m].
        max_payload: maximum bank volume in the bucket [m^3].
        max_stuck_time: longest time with a drive command and a free tool in which the machine
            moved less than `STUCK_DISTANCE` [s].
        imbalance: volume imbalance of the worst tick [mm^3].
        max_particles: maximum number of particles at once.
        num_reseats: number of times a track came off its wheels.
        wall_time: wall time of the run [s].
    """

    seconds: float = 0.0
    problem: str = ""
    num_tilt_stops: int = 0
    distance: float = 0.0
    max_payload: float = 0.0
    max_stuck_time: float = 0.0
    imbalance: int = 0
    max_particles: int = 0
    num_reseats: int = 0
    wall_time: float = 0.0


def rolling_ground(seed: int) -> Array:
    """Return heights [m] of ground of 14 random waves, about 0.3 m high in total."""
    rng = np.random.default_rng(seed)
    cells = np.arange(GRID.rows)
    x, y = np.meshgrid(GRID.x(cells), GRID.y(cells), indexing="ij")
    heights = np.zeros(GRID.shape)
    for _ in range(14):
        kx, ky, phase = *rng.normal(0.0, 0.6, 2), rng.uniform(0.0, 2.0 * math.pi)
        heights += 0.1 * np.sin(kx * x + ky * y + phase) / (1.0 + 1.2 * math.hypot(kx, ky))
    return heights


def waves(seed: int) -> Array:
    """Return heights [m] of waves of 0.4 m, 6 m long, in a random direction."""
    x, y = np.meshgrid(GRID.x(np.arange(GRID.rows)), GRID.y(np.arange(GRID.cols)), indexing="ij")
    direction = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi)
    along = x * math.cos(direction) + y * math.sin(direction)
    return np.asarray(0.2 * np.sin(2.0 * math.pi / 6.0 * along))


def place_machine(soil: Soil, model: TrackModel, seed: int) -> MachineSim:
    """Return a simulation of the excavator in the middle of the map."""
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
    """An operator with random commands, and its world.

    Attributes:
        sim: simulation of the machine.
        world: world of soil and machine.
        outcome: result so far.
    """

    def __init__(
        self, model: TrackModel, seed: int, soil: str = "loam", *, drive_only: bool = False
    ) -> None:
        heights = waves(seed) if drive_only and seed % 2 else rolling_ground(seed)
        ground = Soil(GRID, heights, SoilParams(soil=soil))
        self.sim = place_machine(ground, model, seed)
        self.world = World(ground, {1: self.sim})
        self.outcome = DrivingOutcome()
        self._rng = np.random.default_rng(seed)
        self._drive_only = drive_only
        self._last_position = self.sim.machine.base_pose[0]
        self._stuck_reference = self._last_position  # position at the start of the stuck time
        self._stuck_time = 0.0  # time with a drive command since then [s]

    def run(self, seconds: float) -> DrivingOutcome:
        """Work for some simulated seconds, or until the run fails."""
        start, outcome = time.perf_counter(), self.outcome
        try:
            while outcome.seconds < seconds and not outcome.problem:
                self._perform_action()
        except MachineError as error:
            outcome.problem = str(error)
        outcome.num_reseats = sum(self.sim.machine.tracks.num_reseats)
        outcome.wall_time = time.perf_counter() - start
        return outcome

    def close(self) -> None:
        """Close the world."""
        self.world.close()

    def _perform_action(self) -> None:
        """Dig, drive, or both for one to four seconds, then correct the tilt if necessary."""
        if self._drive_only:
            self._hold_command(
                np.zeros(4), self._choose_track_speeds(), self._rng.uniform(0.3, 4.0)
            )
            return
        kind, duration = self._rng.integers(4), self._rng.uniform(1.0, 4.0)
        digs, drives = kind > 0, kind < 2
        joints = self._rng.uniform(-1.0, 1.0, 4) * MAX_JOINT_SPEEDS if digs else LIFT_VELOCITIES
        self._hold_command(joints, self._choose_track_speeds() if drives else (0.0, 0.0), duration)
        if self.sim.machine.tilt > STOP_TILT:
            self._recover_from_tilt()

    def _choose_track_speeds(self) -> tuple[float, float]:
        """Return random track speeds [m/s], or speeds back toward the middle of the map."""
        tracks = TRACK_SPEEDS[self._rng.integers(len(TRACK_SPEEDS))]
        if self._drive_only:
            speed = self.sim.machine.spec.tracks.max_speed
            left, right = (speed * self._rng.uniform(-1.0, 1.0, 2)).tolist()
            tracks = (left, right) if self._rng.integers(2) else (math.copysign(speed, left),) * 2
        position, quaternion = self.sim.machine.base_pose
        if np.hypot(*position[:2]) > MAX_DISTANCE_FROM_CENTRE:
            speed = max(map(abs, tracks)) if self._drive_only else 0.8
            speed = -speed if position @ rotation_matrix(quaternion)[:, 0] > 0.0 else speed
            tracks = (speed, speed)
        return tracks

    def _recover_from_tilt(self) -> None:
        """Stop, and move the boom until the machine is upright again."""
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
        """Return whether the machine tips toward the bucket, rather than away from it."""
        machine = self.sim.machine
        position, quaternion = machine.base_pose
        reach = machine.tool.pose[1] - position
        return bool(rotation_matrix(quaternion)[:2, 2] @ reach[:2] > 0.0)

    def _hold_command(self, joints: Array, tracks: tuple[float, float], seconds: float) -> None:
        """Hold a command for some seconds, or until the machine begins to tilt too far."""
        self.sim.command(joints, np.array(tracks))
        was_tilted = self.sim.machine.tilt > STOP_TILT
        for _ in range(round(seconds / self.sim.params.tick_period)):
            self._step(is_driving=tracks[0] * tracks[1] > 0.0)
            if self.outcome.problem or (self.sim.machine.tilt > STOP_TILT and not was_tilted):
                break

    def _step(self, *, is_driving: bool) -> None:
        """Advance one tick and update the outcome."""
        outcome, machine, tick = self.outcome, self.sim.machine, self.sim.params.tick_period
        ledger = self.world.step()
        outcome.seconds += tick
        outcome.imbalance = max(outcome.imbalance, ledger.imbalance, key=abs)
        outcome.max_particles = max(outcome.max_particles, self.sim.particles.count)
        outcome.max_payload = max(outcome.max_payload, self.sim.payload.bank_m3)
        position = machine.base_pose[0]
        outcome.distance += float(np.linalg.norm(position - self._last_position))
        self._last_position = position
        if np.linalg.norm(position - self._stuck_reference) > STUCK_DISTANCE:
            self._stuck_reference, self._stuck_time = position, 0.0
        elif is_driving and np.linalg.norm(self.sim.tool_coupling.wrench[0]) < FREE_TOOL_FORCE:
            self._stuck_time += tick
            outcome.max_stuck_time = max(outcome.max_stuck_time, self._stuck_time)
        if machine.overturned:
            outcome.problem = "overturned"
        elif not np.isfinite([*position, *machine.joint_positions]).all():
            outcome.problem = "state not finite"
        elif np.linalg.norm(machine.base_velocity[0]) > MAX_SPEED:
            outcome.problem = f"faster than {MAX_SPEED:g} m/s"


COLUMNS = (
    *(Column("time [s]", "s", ".0f"), Column("distance [m]", "m", ".0f")),
    *(Column("stuck [s]", "s", ".1f"), Column("payload [m3]", "m3", ".2f")),
    *(Column("particles", "", "d"), Column("tilt stops", "", "d")),
    Column("off wheels", "", "d"),
    *(Column("imbalance [mm3]", "mm3", "d"), Column("real-time factor", "", ".1f")),
)


def main() -> None:
    """Run all seeds and print a row for each."""
    parser = make_parser(__doc__)
    parser.add_argument("--model", choices=TRACK_MODELS, help="only this track model")
    parser.add_argument("--minutes", type=float, default=1.0, help="simulated time of a run (1)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="random seeds")
    parser.add_argument("--soil", default="loam", help="name of a soil in config/soils.yaml")
    parser.add_argument("--drive-only", action="store_true", help="fast driving, no digging")
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json, row_width=20)
    table.print_note(describe_load())
    table.print_header()
    for model in (options.model,) if options.model else TRACK_MODELS:
        for seed in options.seeds:
            operator = RandomOperator(model, seed, options.soil, drive_only=options.drive_only)
            outcome = operator.run(60.0 * options.minutes)
            operator.close()
            values = [
                *(outcome.seconds, outcome.distance, outcome.max_stuck_time),
                *(outcome.max_payload, outcome.max_particles, outcome.num_tilt_stops),
                outcome.num_reseats,
                *(outcome.imbalance, outcome.seconds / outcome.wall_time),
            ]
            remark = outcome.problem or "no problem"
            table.print_row(f"{model}, seed {seed}", values, remark=remark)


if __name__ == "__main__":
    main()

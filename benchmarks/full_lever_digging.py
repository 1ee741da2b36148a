"""Dig with the levers at their ends: what the bucket holds, how fast soil moves, and the forces.

    python -m benchmarks.full_lever_digging                 # all scenes, about 15 minutes
    python -m benchmarks.full_lever_digging --scenes swing  # the windrow of a swing

Three scenes of the excavator on nearly level loam. `swing` lowers the bucket slowly to a depth, and
swings it through the ground at full lever. `stop` digs, and stops all levers when the bucket is
filled in part. `joystick` moves each lever at random from end to end.

Prints a row for each run: the maximum fill; the speed of the fastest particle in excess of 1.5
times that of the fastest point of the tool and of the free fall from the highest point of the tool
and of the soil in the last two seconds (its heap is higher than the bucket, and soil that falls
hits other soil); the largest force of the particles and of the ground on the tool, the latter
upward where the boom lifts the tracks and the machine stands on its bucket; the soil cut.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from earthmoving_sim.world import World
from machine_sim.machine import MachineError, load_machine_spec
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import rough

__all__ = ["SCENES", "DiggingOutcome", "LeverRun"]

Array = NDArray[np.float64]

GRID = Grid(161, 161, 0.2)

ROUGHNESS, CORRELATION_LENGTH = 0.05, 3.0
"""Root mean square height and correlation length of the ground [m]."""

SPEED_FACTOR = 1.5
"""Speed of a particle over that of the fastest point of the tool at which nothing has burst."""

WINDOW_TICKS = 200
"""Ticks before a particle's speed is measured in which the tool may have thrown it."""

START_REACH, START_HEIGHT = 6.8, 0.2
"""Initial distance of the lip from the swing axis, and its height [m]."""

ATTITUDE = 1.2
"""Initial attitude of the bucket [rad]: its floor descends toward the lip."""

STOP_TILT = 0.35
"""Tilt [rad] at which the operator raises the boom."""

DEMO_SOIL = SoilParams(repose_angle=35.0, swell=0.15)
"""Loam without cohesion, as in `config/demo.yaml`: it resists least, and flows at once."""

LOWERING_LEVER, SWING_DEPTH = 0.15, 0.4
"""Lever of the boom, and depth [m], at which it is released, before a swing through the ground."""

LEVERS_AT_REST = (0, 0, 0, 0)


@dataclass
class DiggingOutcome:
    """Result of a run.

    Attributes:
        problem: why the run ended early; empty if it did not.
        seconds: simulated time [s].
        max_fill: maximum fill of the bucket, in heaped capacities.
        max_held: maximum volume of pending soil and particles, in heaped capacities.
        max_pending: maximum bank volume of pending soil [m^3].
        max_speed: maximum speed of a particle [m/s].
        max_excess_speed: maximum of the speed of a particle less that which tool and fall explain
            [m/s]; below 0 if all are explained.
        max_load_force: maximum force of the particles on the tool [N].
        max_resistance: maximum force of the ground on the tool [N].
        max_dug: maximum bank volume taken from the terrain at once [m^3].
        imbalance: volume imbalance of the worst tick [mm^3].
        max_particles: maximum number of particles at once.
        wall_time: wall time of the run [s].
    """

    problem: str = ""
    seconds: float = 0.0
    max_fill: float = 0.0
    max_held: float = 0.0
    max_pending: float = 0.0
    max_speed: float = 0.0
    max_excess_speed: float = -math.inf
    max_load_force: float = 0.0
    max_resistance: float = 0.0
    max_dug: float = 0.0
    imbalance: int = 0
    max_particles: int = 0
    wall_time: float = 0.0


@dataclass
class LeverRun:
    """An excavator whose levers are held at their ends.

    Attributes:
        sim: the machine.
        world: soil and machine.
        outcome: result so far.
        remark: what else the run shows.
    """

    seed: int
    soil: str = ""
    grid: Grid = GRID
    sim: MachineSim = field(init=False)
    world: World = field(init=False)
    outcome: DiggingOutcome = field(init=False)
    remark: str = ""

    def __post_init__(self) -> None:
        site = rough(self.grid, ROUGHNESS, CORRELATION_LENGTH, np.random.default_rng(self.seed))
        ground = Soil(self.grid, site.heights, self._soil_params())
        spec = load_machine_spec(find_config("machines/excavator.yaml"))
        angles = solve_arm_angles(
            spec, START_REACH, START_HEIGHT - arm_geometry(spec).swing[2], ATTITUDE
        )
        spec = replace(spec, home=np.array([0.0, *angles]))
        self.sim = MachineSim(
            [Placement(spec)],
            self.grid,
            ground.columns.height,
            soils=ground.loose_soils,
            soil=ground.columns.top_soil,
            moisture=ground.columns.top_moisture,
            seed=self.seed,
        )
        self.world = World(ground, {1: self.sim})
        self.outcome = DiggingOutcome()
        self._velocities = np.array([spec.joints[name].max_velocity for name in spec.joint_names])
        self._capacity = spec.bucket.heaped_capacity
        self._key_points = self.sim.tool_coupling.key_points_at(0)
        # Speed of the tool [m/s]; highest point of tool and soil [m].
        self._tool_motion: deque[tuple[float, float]] = deque(maxlen=WINDOW_TICKS)

    def _soil_params(self) -> SoilParams:
        return SoilParams(soil=self.soil) if self.soil else DEMO_SOIL

    def hold(self, levers: tuple[float, ...], seconds: float) -> None:
        """Hold levers, -1 to 1 for each joint, for a time."""
        self.hold_until(levers, lambda: False, seconds)

    def hold_until(
        self, levers: tuple[float, ...], is_reached: Callable[[], bool], seconds: float
    ) -> bool:
        """Hold levers until a condition holds, at most for a time; return whether it does."""
        self.sim.command(self._velocities * levers, np.zeros(2))
        for _ in range(round(seconds / self.sim.params.tick_period)):
            if is_reached():
                return True
            self._step()
        return is_reached()

    def close(self) -> None:
        """Release the physics engine."""
        self.world.close()

    @property
    def depth(self) -> float:
        """Depth of the lowest key point below height 0 [m]."""
        return -float(self._key_points[:, 2].min())

    def _step(self) -> None:
        """Advance one tick and update the outcome."""
        start = time.perf_counter()
        ledger = self.world.step()
        outcome, sim, coupling = self.outcome, self.sim, self.sim.tool_coupling
        outcome.wall_time += time.perf_counter() - start
        tick = sim.params.tick_period
        outcome.seconds += tick
        before, self._key_points = self._key_points, coupling.key_points_at(0)
        speed = float(np.linalg.norm(self._key_points - before, axis=1).max()) / tick
        heights = np.append(self._key_points[:, 2], sim.particles.positions[:, 2])
        self._tool_motion.append((speed, float(heights.max())))
        outcome.max_fill = max(outcome.max_fill, sim.payload.fill)
        swell = 1.0 + sim.particles.soils[0].swell
        held = sim.pending_mm3 + sim.particles.total_volume_mm3
        outcome.max_held = max(outcome.max_held, held * 1e-9 * swell / self._capacity)
        outcome.max_pending = max(outcome.max_pending, sim.pending_mm3 * 1e-9)
        outcome.max_dug = max(outcome.max_dug, (ledger.start - ledger.terrain) * 1e-9)
        outcome.max_particles = max(outcome.max_particles, sim.particles.count)
        outcome.imbalance = max(outcome.imbalance, ledger.imbalance, key=abs)
        load = float(np.linalg.norm(sim.particles.tool_wrench(coupling.tool_id)[0]))
        outcome.max_load_force = max(outcome.max_load_force, load)
        wrench = coupling.wrench[0] - sim.particles.tool_wrench(coupling.tool_id)[0]
        outcome.max_resistance = max(outcome.max_resistance, float(np.linalg.norm(wrench)))
        if sim.particles.count:
            self._measure_speeds()

    def _measure_speeds(self) -> None:
        particles = self.sim.particles
        speeds = np.linalg.norm(particles.velocities, axis=1)
        tool_speed = max(speed for speed, _ in self._tool_motion)
        top = max(height for _, height in self._tool_motion)
        fall = np.sqrt(2.0 * GRAVITY * np.maximum(top - particles.positions[:, 2], 0.0))
        excess = speeds - SPEED_FACTOR * tool_speed - fall
        self.outcome.max_speed = max(self.outcome.max_speed, float(speeds.max()))
        self.outcome.max_excess_speed = max(self.outcome.max_excess_speed, float(excess.max()))


def swing(run: LeverRun, seconds: float) -> None:
    """Lower the bucket into the ground, and swing it through it at full lever."""
    run.hold_until((0, LOWERING_LEVER, 0, 0), lambda: run.depth > SWING_DEPTH, 10.0)
    run.hold(LEVERS_AT_REST, 0.5)
    run.hold((1, 0, 0, 0), min(seconds, 4.0))
    run.hold(LEVERS_AT_REST, 1.0)


def stop(run: LeverRun, seconds: float) -> None:
    """Dig at full levers, and hold the arm still when the bucket is filled to 0.6."""
    run.hold_until((0, 1, 0, 0), lambda: run.depth > 0.2, 4.0)
    run.hold_until((0, 0, 1, 0), lambda: run.sim.payload.fill > 0.6, 4.0)
    moving = run.sim.payload.fill
    run.hold(LEVERS_AT_REST, 0.5)
    still = run.sim.payload.fill
    run.hold(LEVERS_AT_REST, min(seconds, 4.0))
    run.remark = f"fill {moving:.2f}, at rest {still:.2f}, then {run.sim.payload.fill:.2f}"


def joystick(run: LeverRun, seconds: float) -> None:
    """Move each lever at random from end to end."""
    rng = np.random.default_rng(run.seed)
    machine = run.sim.machine
    while run.outcome.seconds < seconds and not run.outcome.problem:
        levers = tuple(int(lever) for lever in rng.integers(-1, 2, 4))
        run.hold_until(levers, lambda: machine.tilt > STOP_TILT, float(rng.uniform(0.3, 1.5)))
        if machine.tilt > STOP_TILT:
            run.hold_until((0, -1, 0, 0), lambda: machine.tilt < 0.5 * STOP_TILT, 4.0)
        if machine.overturned:
            run.outcome.problem = "overturned"


SCENES: dict[str, Callable[[LeverRun, float], None]] = {
    "swing": swing,
    "stop": stop,
    "joystick": joystick,
}
"""Scenes by name; each gets a run and its maximum simulated time [s]."""

COLUMNS = (
    *(Column("time [s]", "s", ".0f"), Column("fill", "", ".2f"), Column("held", "", ".2f")),
    *(Column("pending [m3]", "m3", ".3f"), Column("dug [m3]", "m3", ".2f")),
    *(Column("speed [m/s]", "m/s", ".1f"), Column("excess [m/s]", "m/s", ".1f")),
    *(Column("load [kN]", "kN", ".0f"), Column("ground [kN]", "kN", ".0f")),
    *(Column("particles", "", "d"), Column("imbalance [mm3]", "mm3", "d")),
    Column("real-time factor", "", ".1f"),
)


def main() -> None:
    """Run all scenes with all seeds and print a row for each."""
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", choices=SCENES, nargs="+", default=list(SCENES))
    parser.add_argument("--minutes", type=float, default=3.0, help="simulated time of a run (3)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="random seeds")
    parser.add_argument("--soil", default="", help="name of a soil in config/soils.yaml (demo)")
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json, row_width=20)
    table.print_note(describe_load())
    table.print_header()
    for scene in options.scenes:
        for seed in options.seeds:
            run = LeverRun(seed, options.soil)
            try:
                SCENES[scene](run, 60.0 * options.minutes)
            except MachineError as error:
                run.outcome.problem = str(error)
            run.close()
            outcome = run.outcome
            values = [
                *(outcome.seconds, outcome.max_fill, outcome.max_held, outcome.max_pending),
                *(outcome.max_dug, outcome.max_speed, outcome.max_excess_speed),
                *(1e-3 * outcome.max_load_force, 1e-3 * outcome.max_resistance),
                *(outcome.max_particles, outcome.imbalance, outcome.seconds / outcome.wall_time),
            ]
            table.print_row(f"{scene}, seed {seed}", values, remark=outcome.problem or run.remark)


if __name__ == "__main__":
    main()

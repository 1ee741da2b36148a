"""Scoops with every joint of the excavator at its top speed: nothing goes through the bucket.

The shipped excavator, on the soil of `config/demo.yaml`, gets maximum joint velocities. It plunges
its bucket into rough ground, drags, curls, lifts and swings, reverses and shakes, strikes the
ground with its load, opens and flails. Seeds vary terrain, heading, posture, rotations and times.

The lip goes at up to 11 m/s then, 55 mm in a physics step: a particle's radius. None may get
through a plate or the ground all the same, and no soil be lost.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.validation.plate_tunnelling import TunnellingMonitor
from earthmoving_sim.run_config import RunConfig, load_run_config
from earthmoving_sim.world import World
from machine_sim.machine import EXCAVATOR_JOINTS, MachineSpec, ReachError
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.terrain import rough

__all__ = ["ScoopResult", "run_scoop"]

_GRID = Grid(161, 161, 0.2)
_ROUGHNESS, _HILLS = 0.1, 3.0
"""Height and length of what the ground goes up and down [m]."""
_REACH = (5.5, 7.3)
"""Of the lip at the start, from the swing axis [m]."""
_HEIGHT = (0.2, 0.6)
"""Of the lip over the ground at the start [m]: room to get to full speed."""
_ATTITUDE = (1.3, 2.0)
"""Of the bucket at the start [rad]: the lip looks down."""


class HeldCommand(NamedTuple):
    """A command that is held.

    Attributes:
        turn: -1, 0 or 1 for each joint, in parts of its top speed.
        longest: for so long [s].
        depth: or until the bucket's lowest corner is so deep under level ground [m].
        fill: or until the bucket is so full, in heaped buckets.
    """

    direction: tuple[int, int, int, int]
    max_duration: float
    depth: float = math.inf
    fill: float = math.inf


@dataclass(frozen=True)
class ScoopResult:
    """What happened in a scoop.

    Attributes:
        seconds: simulated.
        particles: most there were at once.
        held: most that were in the bucket at once.
        dug: bank volume out of the ground, at most [m^3].
        rates: greatest speed of each joint over its limit, shape (4,).
        tip_speed: greatest of the lip's middle [m/s].
        fastest: greatest of a particle in the bucket, seen from it [m/s].
        riding: most that rode in the bucket as one body.
        imbalance: of the ledger, worst of all ticks [mm^3].
        sound: whether columns and accounts of the terrain agree at the end.
        tunnelled: through plates, as the engine counts.
        sunk: through the ground, as the engine counts.
        pierced: through plates, as told from positions.
    """

    seconds: float
    particles: int
    max_in_bucket: int
    max_dug_volume: float
    joint_speed_ratios: NDArray[np.float64]
    max_tip_speed: float
    max_particle_speed: float
    max_locked_particles: int
    imbalance: int
    is_consistent: bool
    tunnelled: int
    num_sunk: int
    count_tunnelled: int


def run_scoop(seed: int) -> ScoopResult:
    """Make a world, and one scoop in it.

    Args:
        seed: of everything left to chance.
    """
    config = load_run_config("demo.yaml")
    rng = np.random.default_rng(seed)
    world = _world(config, rng, seed)
    try:
        return _Run(world, config.stepping.tick_period).follow(_strokes(rng))
    finally:
        world.close()


class _Run:
    """A scoop in the making."""

    def __init__(self, world: World, tick: float) -> None:
        self._world, self._tick = world, tick
        self._machine = world.machines[1]
        spec = self._machine.machine.spec
        self._top = np.array([spec.joints[name].max_velocity for name in EXCAVATOR_JOINTS])
        self._tip = spec.bucket.tip_radius
        self._corners = spec.bucket.key_points
        self._watch = TunnellingMonitor(self._machine)
        self._rates = np.zeros(len(EXCAVATOR_JOINTS))
        self._tip_speed = self._dug = 0.0
        self._particles = self._imbalance = 0

    def follow(self, strokes: Iterator[HeldCommand]) -> ScoopResult:
        """Give the commands of a scoop; what came of it."""
        for stroke in strokes:
            self._machine.command(self._top * stroke.direction, np.zeros(2))
            for _ in range(round(stroke.max_duration / self._tick)):
                self._step()
                if self._depth > stroke.depth or self._machine.payload.fill > stroke.fill:
                    break
        engine, watch = self._machine.particles, self._watch
        return ScoopResult(
            self._world.tick * self._tick,
            self._particles,
            watch.max_in_bucket,
            self._dug,
            self._rates,
            self._tip_speed,
            watch.max_particle_speed,
            watch.max_locked_particles,
            self._imbalance,
            self._world.soil.verify_volume(),
            engine.num_plate_tunnellings,
            engine.num_ground_tunnellings,
            watch.count_tunnelled,
        )

    def _step(self) -> None:
        ledger = self._world.step()
        machine = self._machine.machine
        velocity, spin = machine.tool.velocity
        max_tip_speed = np.linalg.norm(velocity + np.cross(spin, self._lip))
        self._tip_speed = max(self._tip_speed, float(max_tip_speed))
        self._rates = np.maximum(self._rates, np.abs(machine.joint_velocities) / self._top)
        self._particles = max(self._particles, self._machine.particles.count)
        self._dug = max(self._dug, (ledger.start - ledger.terrain) * 1e-9)
        self._imbalance = max(self._imbalance, abs(ledger.imbalance))

    @property
    def _lip(self) -> NDArray[np.float64]:
        """From the bucket's pin to the middle of its lip [m], map axes."""
        return self._machine.machine.tool.pose[0][:, 0] * self._tip

    @property
    def _depth(self) -> float:
        """Of the bucket's lowest corner under level ground [m]."""
        rotation, origin = self._machine.machine.tool.pose
        return -float((self._corners @ rotation[2]).min() + origin[2])


def _world(config: RunConfig, rng: np.random.Generator, seed: int) -> World:
    """An excavator amid rough ground, its lip above it somewhere.

    No pump holds it back: each joint goes as fast as it ever may, whatever the others do.
    """
    site = rough(_GRID, _ROUGHNESS, _HILLS, rng)
    soil = Soil(site.grid, site.heights, config.soil)
    home = _posture(config.machine, rng)
    spec = replace(config.machine, home=home, cylinders={}, supply=None)
    machine = MachineSim(
        [Placement(spec, yaw=rng.uniform(-math.pi, math.pi))],
        site.grid,
        soil.columns.height,
        params=config.stepping,
        particle_params=config.particles,
        soils=soil.loose_soils,
        seed=seed,
    )
    return World(soil, {1: machine})


def _posture(machine: MachineSpec, rng: np.random.Generator) -> NDArray[np.float64]:
    """Joint angles to start with [rad]."""
    while True:
        reach, height, attitude = (rng.uniform(*span) for span in (_REACH, _HEIGHT, _ATTITUDE))
        try:
            angles = solve_arm_angles(
                machine, reach, height - arm_geometry(machine).swing[2], attitude
            )
        except ReachError:
            continue
        return np.array([rng.uniform(-math.pi, math.pi), *angles])


def _strokes(rng: np.random.Generator) -> Iterator[HeldCommand]:
    """What a scoop consists of; boom, arm and bucket turn downward, in, and in."""

    def either() -> int:
        return int(rng.choice([-1, 1]))

    aside, drawn = either(), int(rng.choice([0, 1]))
    full = rng.uniform(0.2, 0.8)
    yield HeldCommand((0, 1, drawn, 0), 1.5, depth=rng.uniform(0.1, 0.2), fill=full)  # plunge
    yield HeldCommand((0, -drawn, 1, 0), 0.8, depth=0.35, fill=full)  # drag
    yield HeldCommand((0, -1, 0, 1), rng.uniform(0.4, 0.8), fill=0.8)  # curl
    yield HeldCommand((aside, -1, 0, 1), rng.uniform(0.75, 0.9))  # lift and swing
    if rng.uniform() < 0.1:  # let it come to rest, to ride as one body
        yield HeldCommand((0, 0, 0, 0), 4.5)
    yield HeldCommand((-aside, 0, 0, 1), rng.uniform(0.2, 0.5))  # reverse
    for k in range(4):  # shake
        yield HeldCommand((-aside, 0, either(), (-1) ** (k + 1)), rng.uniform(0.06, 0.15))
    if rng.uniform() < 0.5:  # strike the ground
        yield HeldCommand((-aside, 1, 0, 1), 1.0, depth=0.0)
        yield HeldCommand((-aside, -1, 0, 1), 0.4)
    yield HeldCommand((-aside, -1, -1, -1), rng.uniform(0.6, 0.9))  # throw open
    for _ in range(3):  # flail
        yield HeldCommand((either(), either(), either(), either()), rng.uniform(0.15, 0.3))

"""Scoop with every joint of the excavator at its maximum speed; no particle may tunnel.

The shipped excavator, on the soil of `config/demo.yaml`, gets maximum joint velocities. It plunges
its bucket into rough ground, drags, curls, lifts and swings, reverses and shakes, strikes the
ground with its load, opens the bucket and moves all joints at random. The seed varies terrain,
heading, posture, directions and durations.

The lip reaches 11 m/s, or 55 mm in a physics step, which is a particle radius. Still, no particle
may pass through a plate or the ground, and no soil may be lost.
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
_ROUGHNESS, _CORRELATION_LENGTH = 0.1, 3.0
"""Root mean square height and correlation length of the ground [m]."""
_REACH = (5.5, 7.3)
"""Range of the initial distance of the lip from the swing axis [m]."""
_HEIGHT = (0.2, 0.6)
"""Range of the initial height of the lip, enough to reach full speed above the ground [m]."""
_ATTITUDE = (1.3, 2.0)
"""Range of the initial bucket attitude [rad]; the lip points down."""
_SWING = (250e3, 1.1, 1.5)
"""Torque [N m], speed [rad/s] and acceleration [rad/s^2] of the swing: more than the machine's, so
that it reaches full speed in a short scoop."""


class HeldCommand(NamedTuple):
    """A command that is held until one of its limits is reached.

    Attributes:
        direction: -1, 0 or 1 for each joint, times its maximum speed.
        max_duration: duration limit [s].
        depth: limit of the depth of the bucket's lowest corner below height 0 [m].
        fill: limit of the fill, in heaped capacities.
    """

    direction: tuple[int, int, int, int]
    max_duration: float
    depth: float = math.inf
    fill: float = math.inf


@dataclass(frozen=True)
class ScoopResult:
    """Result of a scoop.

    Attributes:
        seconds: simulated time [s].
        max_particles: maximum number of particles at once.
        max_in_bucket: maximum number of particles in the bucket at once.
        max_dug_volume: maximum bank volume taken from the terrain [m^3].
        joint_speed_ratios: maximum speed of each joint over its limit, shape (4,).
        max_tip_speed: maximum speed of the middle of the lip [m/s].
        max_particle_speed: maximum speed of a particle in the bucket, relative to it [m/s].
        max_locked_particles: maximum number of particles in the locked load.
        imbalance: maximum volume imbalance of a tick [mm^3].
        is_consistent: whether columns and accounts of the terrain agree at the end.
        num_plate_tunnellings: passages through plates, counted by the engine.
        num_ground_tunnellings: passages through the ground, counted by the engine.
        num_crossings: passages through plates, found from positions.
    """

    seconds: float
    max_particles: int
    max_in_bucket: int
    max_dug_volume: float
    joint_speed_ratios: NDArray[np.float64]
    max_tip_speed: float
    max_particle_speed: float
    max_locked_particles: int
    imbalance: int
    is_consistent: bool
    num_plate_tunnellings: int
    num_ground_tunnellings: int
    num_crossings: int


def run_scoop(seed: int) -> ScoopResult:
    """Run one scoop in a world of its own.

    Args:
        seed: seed of terrain, machine and commands.
    """
    config = load_run_config("demo.yaml")
    rng = np.random.default_rng(seed)
    world = _make_world(config, rng, seed)
    try:
        return _Run(world, config.stepping.tick_period).follow(_commands(rng))
    finally:
        world.close()


class _Run:
    """A scoop in progress, with the maxima so far."""

    def __init__(self, world: World, tick: float) -> None:
        self._world, self._tick = world, tick
        self._machine = world.machines[1]
        spec = self._machine.machine.spec
        self._max_velocities = np.array(
            [spec.joints[name].max_velocity for name in EXCAVATOR_JOINTS]
        )
        self._tip_radius = spec.bucket.tip_radius
        self._corners = spec.bucket.key_points
        self._monitor = TunnellingMonitor(self._machine)
        self._joint_speed_ratios = np.zeros(len(EXCAVATOR_JOINTS))
        self._max_tip_speed = self._max_dug_volume = 0.0
        self._max_particles = self._imbalance = 0

    def follow(self, commands: Iterator[HeldCommand]) -> ScoopResult:
        """Apply the commands of a scoop and return its result."""
        for command in commands:
            self._machine.command(self._max_velocities * command.direction, np.zeros(2))
            for _ in range(round(command.max_duration / self._tick)):
                self._step()
                if self._depth > command.depth or self._machine.payload.fill > command.fill:
                    break
        engine, monitor = self._machine.particles, self._monitor
        return ScoopResult(
            seconds=self._world.tick * self._tick,
            max_particles=self._max_particles,
            max_in_bucket=monitor.max_in_bucket,
            max_dug_volume=self._max_dug_volume,
            joint_speed_ratios=self._joint_speed_ratios,
            max_tip_speed=self._max_tip_speed,
            max_particle_speed=monitor.max_particle_speed,
            max_locked_particles=monitor.max_locked_particles,
            imbalance=self._imbalance,
            is_consistent=self._world.soil.verify_volume(),
            num_plate_tunnellings=engine.num_plate_tunnellings,
            num_ground_tunnellings=engine.num_ground_tunnellings,
            num_crossings=monitor.num_crossings,
        )

    def _step(self) -> None:
        """Advance one tick and update the maxima."""
        ledger = self._world.step()
        machine = self._machine.machine
        velocity, angular_velocity = machine.tool.velocity
        tip_speed = float(np.linalg.norm(velocity + np.cross(angular_velocity, self._lip)))
        self._max_tip_speed = max(self._max_tip_speed, tip_speed)
        ratios = np.abs(machine.joint_velocities) / self._max_velocities
        self._joint_speed_ratios = np.maximum(self._joint_speed_ratios, ratios)
        self._max_particles = max(self._max_particles, self._machine.particles.count)
        self._max_dug_volume = max(self._max_dug_volume, (ledger.start - ledger.terrain) * 1e-9)
        self._imbalance = max(self._imbalance, abs(ledger.imbalance))

    @property
    def _lip(self) -> NDArray[np.float64]:
        """Vector from the bucket pin to the middle of the lip [m], map axes."""
        return self._machine.machine.tool.pose[0][:, 0] * self._tip_radius

    @property
    def _depth(self) -> float:
        """Depth of the bucket's lowest corner below height 0 [m]."""
        rotation, origin = self._machine.machine.tool.pose
        return -float((self._corners @ rotation[2]).min() + origin[2])


def _make_world(config: RunConfig, rng: np.random.Generator, seed: int) -> World:
    """Return a world with an excavator on rough ground, its lip at a random position above it.

    The machine has no hydraulics: each joint reaches its maximum speed, independent of the others.
    """
    site = rough(_GRID, _ROUGHNESS, _CORRELATION_LENGTH, rng)
    soil = Soil(site.grid, site.heights, config.soil)
    home = _posture(config.machine, rng)
    joints = dict(config.machine.joints)
    effort, velocity, acceleration = _SWING
    joints["swing"] = replace(
        joints["swing"], max_effort=effort, max_velocity=velocity, max_acceleration=acceleration
    )
    tracks = replace(config.machine.tracks, motor=None)
    spec = replace(
        config.machine,
        home=home,
        joints=joints,
        tracks=tracks,
        cylinders={},
        motors={},
        supply=None,
    )
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
    """Return random initial joint angles [rad]."""
    while True:
        reach, height, attitude = (rng.uniform(*span) for span in (_REACH, _HEIGHT, _ATTITUDE))
        try:
            angles = solve_arm_angles(
                machine, reach, height - arm_geometry(machine).swing[2], attitude
            )
        except ReachError:
            continue
        return np.array([rng.uniform(-math.pi, math.pi), *angles])


def _commands(rng: np.random.Generator) -> Iterator[HeldCommand]:
    """Yield the commands of a scoop; positive is boom down, arm in, and bucket curl in."""

    def random_sign() -> int:
        return int(rng.choice([-1, 1]))

    swing, arm = random_sign(), int(rng.choice([0, 1]))
    fill = rng.uniform(0.2, 0.8)
    yield HeldCommand((0, 1, arm, 0), 1.5, depth=rng.uniform(0.1, 0.2), fill=fill)  # plunge
    yield HeldCommand((0, -arm, 1, 0), 0.8, depth=0.35, fill=fill)  # drag
    yield HeldCommand((0, -1, 0, 1), rng.uniform(0.4, 0.8), fill=0.8)  # curl
    yield HeldCommand((swing, -1, 0, 1), rng.uniform(0.75, 0.9))  # lift and swing
    if rng.uniform() < 0.1:  # rest until the load locks
        yield HeldCommand((0, 0, 0, 0), 4.5)
    yield HeldCommand((-swing, 0, 0, 1), rng.uniform(0.2, 0.5))  # reverse
    for k in range(4):  # shake
        yield HeldCommand((-swing, 0, random_sign(), (-1) ** (k + 1)), rng.uniform(0.06, 0.15))
    if rng.uniform() < 0.5:  # strike the ground
        yield HeldCommand((-swing, 1, 0, 1), 1.0, depth=0.0)
        yield HeldCommand((-swing, -1, 0, 1), 0.4)
    yield HeldCommand((-swing, -1, -1, -1), rng.uniform(0.6, 0.9))  # open the bucket
    for _ in range(3):  # move at random
        yield HeldCommand(
            (random_sign(), random_sign(), random_sign(), random_sign()), rng.uniform(0.15, 0.3)
        )

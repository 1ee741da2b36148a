"""An excavator digs in dry sand: path and force of its bucket, and the ground that it leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.world import World
from machine_sim.machine import BucketShape, MachineSpec, load_machine_spec
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement, SimulatedMachine
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

__all__ = ["INTERVAL", "DigRecord", "record_dig"]

Array = NDArray[np.float64]

_SOIL = SoilParams(soil="spheres", soils=str(Path(__file__).with_name("bed_soil.yaml")))
"""Soil without cohesion, with the angles of the bed of spheres."""

INTERVAL = 0.05
"""Time between the records [s]."""

_TICK = 0.01
_SETTLING_TICKS = 100
_GAIN = 5.0
"""Joint velocity for a deviation of the angle [1/s]."""

_PATH = np.array(
    [
        (0.0, 7.0, 0.2, 1.0),
        (1.0, 7.0, 0.02, 1.0),
        (2.0, 6.75, -0.3, 1.2),
        (4.2, 5.5, -0.3, 1.6),
        (5.2, 5.1, -0.02, 2.1),
        (6.0, 5.0, 0.35, 2.6),
    ]
)
"""Time [s], distance of the lip from the machine's centre [m], height [m] and angle [rad]."""


@dataclass(frozen=True)
class DigRecord:
    """A dig in level ground at z = 0; the bucket moves in the plane y = 0, toward -x.

    Attributes:
        bucket: shape of the bucket.
        density: of the soil in place [kg/m^3].
        internal_friction, tool_friction: angles of friction [deg].
        times: ends of the intervals [s], shape (n,).
        origin: bucket pin at these times [m], map frame, shape (n, 3).
        pitch: rotation of the bucket about +y at these times [rad], shape (n,).
        force: force of the soil on the bucket, mean of the interval [N], map axes, shape (n, 3).
        fill: bank volume in the bucket, below its opening [m^3], shape (n,).
        x: positions of the profile [m], ascending, shape (m,).
        profile: height of the ground at the end, mean over 0.6 m across the middle [m], shape (m,).
    """

    bucket: BucketShape
    density: float
    internal_friction: float
    tool_friction: float
    times: Array
    origin: Array
    pitch: Array
    force: Array
    fill: Array
    x: Array
    profile: Array


def record_dig(cell: float = 0.1, seed: int = 0, speed: float = 1.0) -> DigRecord:
    """Return the dig of this project.

    Args:
        cell: size of the columns [m].
        seed: seed of the scatter of released particles.
        speed: speed over that of the path, 0.57 m/s while the bucket cuts level.
    """
    spec = load_machine_spec(find_config("machines/excavator.yaml"))
    path: Array = np.array(
        [_arm_angles(spec, t) for t in np.arange(0.0, _PATH[-1, 0] + _TICK, speed * _TICK)]
    )
    spec = replace(spec, home=np.array([0.0, *path[0]]))
    grid = Grid(round(16.0 / cell) + 1, round(10.0 / cell) + 1, cell)
    soil = Soil(grid, np.zeros(grid.shape), _SOIL)
    sim = MachineSim(
        [Placement(spec)], grid, soil.columns.height, soils=soil.loose_soils, seed=seed
    )
    world = World(soil, {1: sim})
    (machine,) = sim.simulated_machines
    for _ in range(_SETTLING_TICKS):
        _follow(world, sim, machine, path[0], path[0])
    rows = []
    for now, after in pairwise(path):
        _follow(world, sim, machine, now, after)
        rows.append(_observe(sim, machine))
    world.close()
    count = round(INTERVAL / _TICK)
    table = np.array(rows[: len(rows) // count * count]).reshape(-1, count, len(rows[0]))
    kind = soil.soil_types[0]
    middle = np.abs(grid.y(np.arange(grid.cols))) <= 0.3
    times: Array = np.asarray(INTERVAL * np.arange(1, len(table) + 1), dtype=np.float64)
    means: Array = np.asarray(table[:, :, 4:7].mean(axis=1), dtype=np.float64)
    profile: Array = np.asarray(soil.columns.height[::-1, middle].mean(axis=1), dtype=np.float64)
    return DigRecord(
        spec.bucket, kind.density, kind.internal_friction, kind.tool_friction,
        times, table[:, -1, :3], table[:, -1, 3],
        means, table[:, -1, 7], np.asarray(grid.x(np.arange(grid.rows))[::-1]), profile,
    )  # fmt: skip


def _arm_angles(spec: MachineSpec, time: float) -> Array:
    """Return the angles of boom, arm and bucket at a time of the path [rad]."""
    reach, height, angle = (np.interp(time, _PATH[:, 0], _PATH[:, k]) for k in (1, 2, 3))
    origin = float(arm_geometry(spec).swing[2])
    return np.array(solve_arm_angles(spec, float(reach), float(height) - origin, float(angle)))


def _follow(
    world: World, sim: MachineSim, machine: SimulatedMachine, now: Array, after: Array
) -> None:
    """Advance one tick toward the angles after it."""
    error = now - machine.machine.joint_positions[1:4]
    sim.command(np.array([0.0, *((after - now) / _TICK + _GAIN * error)]), np.zeros(2))
    world.step()


def _observe(sim: MachineSim, machine: SimulatedMachine) -> list[float]:
    """Return origin and pitch of the bucket, the force on it, and the volume in it."""
    coupling = machine.couplings["bucket"]
    rotation, origin = coupling.tool.pose
    force, _ = coupling.wrench
    points = sim.particles.positions_in_tool_frame(coupling.tool_id)
    volume = sim.particles.volumes_mm3[machine.machine.spec.bucket.contains(points)].sum()
    pitch = float(np.arctan2(rotation[0, 2], rotation[0, 0]))
    return [*origin.tolist(), pitch, *force.tolist(), 1e-9 * float(volume)]

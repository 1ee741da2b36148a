"""What the machine costs and how well it does, with tracks of either kind, beside what it should.

It drives, stops, stands, pivots, climbs and holds on slopes, goes over a sill and pulls against a
force. Prints a column for each kind of tracks: processor time of a step with all of the machine,
and what it did; a star marks what misses its bar, which is meant for firm ground. Run from the
repository root: `python benchmarks/driving_performance.py`; `--model physics` for one, `--soil
loam` for softer ground. How it digs for minutes on rough ground is `digging_about.py`'s.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineSpec, TrackedMachine, load_machine_spec
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils.soil_types import load_soil_types

Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]

DT = 0.005
"""[s]"""

GRID = Grid(601, 601, 0.1)

PULL_FORCE = 50e3
"""What the machine pulls against [N]."""


@dataclass(frozen=True)
class Row:
    """One line of the table: what was found, and the least and the most that it should be."""

    name: str
    value: float
    digits: int = 3
    minimum: float = -math.inf
    maximum: float = math.inf

    def __str__(self) -> str:
        number = f"{self.value:.1e}" if self.digits == 0 else f"{self.value:.{self.digits}f}"
        return number + (" " if self.minimum <= self.value <= self.maximum else "*")


def load_excavator() -> MachineSpec:
    """The machine that is looked at."""
    return load_machine_spec(find_config("machines/excavator.yaml"))


class Case(NamedTuple):
    """Tracks of a kind, on ground of a kind."""

    model: TrackModel
    soil: LooseSoil


class Site:
    """The machine on its ground."""

    def __init__(self, case: Case, surface: Surface, x: float = 0.0) -> None:
        across = np.arange(GRID.shape[0])
        heights = surface(*np.meshgrid(GRID.x(across), GRID.y(across), indexing="ij"))
        self.client = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(DT, self.client)
        pybullet.setGravity(0.0, 0.0, -9.81, self.client)
        moisture = np.full(GRID.shape, case.soil.moisture, dtype=np.uint8)
        ground = Ground(GRID, heights, soils=[case.soil], moisture=moisture)
        self.machine = TrackedMachine(
            load_excavator(), self.client, ground, (x, 0.0), 0.0, case.model
        )
        self.steps, self.spent = 0, 0.0

    def step(self) -> None:
        """One physics step, and how long it takes."""
        began = time.process_time()
        self.machine.before_step(DT)
        pybullet.stepSimulation(self.client)
        self.machine.after_step()
        self.spent += time.process_time() - began
        self.steps += 1

    def drive(self, left: float, right: float, seconds: float) -> Array:
        """Drive with these speeds [m/s]; returns the places it was at [m], shape (n, 3)."""
        self.machine.command([0.0] * 4, [left, right])
        places = []
        for _ in range(round(seconds / DT)):
            self.step()
            places.append(self.machine.base_pose[0])
        return np.array(places)

    @property
    def heading(self) -> float:
        """[rad]"""
        x, y, z, w = self.machine.base_pose[1]
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def close(self) -> None:
        """Free the physics client."""
        pybullet.disconnect(self.client)


def flat(x: Array, y: Array) -> Array:
    """Level ground."""
    return 0.0 * x


def slope(degrees: float) -> Surface:
    """Ground that rises along x."""
    return lambda x, y: math.tan(math.radians(degrees)) * x


def sill(x: Array, y: Array) -> Array:
    """Level ground with a sill of 0.15 m across it."""
    return np.where((x > 3.0) & (x < 3.6), 0.15, 0.0)


def distance(places: Array) -> float:
    """Between the first and the last place [m]."""
    return float(np.linalg.norm(places[-1] - places[0]))


def on_level_ground(case: Case) -> list[Row]:
    """Cost, speed, stop, drift and pivot."""
    site = Site(case, flat, -10.0)
    site.drive(0.0, 0.0, 2.0)
    site.drive(0.8, 0.8, 2.0)
    site.steps, site.spent = 0, 0.0
    driven = distance(site.drive(0.8, 0.8, 5.0))
    cost = 1e3 * site.spent / site.steps
    stop = site.drive(0.0, 0.0, 15.0)
    drift = distance(site.drive(0.0, 0.0, 60.0))
    site.drive(-0.5, 0.5, 2.0)
    turned = 0.0
    for _ in range(20):
        before = site.heading
        site.drive(-0.5, 0.5, 0.4)
        turned += (site.heading - before + math.pi) % (2.0 * math.pi) - math.pi
    site.close()
    return [
        Row("cost, driving [ms a step]", cost),
        Row("speed, 0.8 asked for [m/s]", driven / 5.0, minimum=0.784, maximum=0.816),
        Row("way to a stop from there [mm]", 1e3 * np.ptp(stop[:200, 0]), 1, maximum=50.0),
        Row("drift, standing [mm/min]", 1e3 * drift, 2, maximum=1.0),
        Row("pivot, 0.42 without slip [rad/s]", turned / 8.0),
    ]


def on_a_slope(case: Case, degrees: float) -> list[Row]:
    """Climb and hold."""
    site = Site(case, slope(degrees), -5.0)
    site.drive(0.0, 0.0, 2.0)
    climbed = distance(site.drive(0.5, 0.5, 6.0))
    site.drive(0.0, 0.0, 2.0)
    crept = distance(site.drive(0.0, 0.0, 10.0))
    site.close()
    return [
        Row(f"climb, {degrees:g} deg, 0.5 asked for [m/s]", climbed / 6.0),
        Row(f"creep, {degrees:g} deg [mm in 10 s]", 1e3 * crept, 2),
    ]


def over_a_sill(case: Case) -> list[Row]:
    """How well the arm holds."""
    site = Site(case, sill)
    site.drive(0.0, 0.0, 2.0)
    held = site.machine.joint_positions
    site.machine.command([0.0] * 4, [0.8, 0.8])
    moved = 0.0
    for _ in range(round(7.0 / DT)):
        site.step()
        moved = max(moved, float(np.abs(site.machine.joint_positions - held).max()))
    site.close()
    return [Row("arm, over a 0.15 m sill [mrad]", 1e3 * moved, maximum=0.1)]


def against_a_force(case: Case) -> list[Row]:
    """Whether the ground gives the machine what pulls at its tool; and how fast it drives so."""
    site = Site(case, flat, -15.0)
    forces: list[Array] = []
    places: list[Array] = []
    site.machine.command([0.0] * 4, [0.8, 0.8])
    for k in range(round(13.0 / DT)):
        site.machine.tool.push([-PULL_FORCE, 0.0, 0.0], [0.0, 0.0, 0.0])
        site.step()
        if k * DT >= 3.0:
            forces.append(site.machine.tracks.wrench[:3].copy())
            places.append(site.machine.base_pose[0])
    error = abs(float(np.mean(forces, axis=0)[0]) / PULL_FORCE - 1.0)
    site.close()
    return [
        Row("speed against 50 kN, 0.8 asked for [m/s]", distance(np.array(places)) / 10.0),
        Row("ground's force less 50 kN [%]", 100.0 * error, 2, maximum=5.0),
    ]


def round_trip() -> float:
    """From a joint's angle to its cylinder's length and back, the worst of all cylinders [rad]."""
    return max(
        abs(cylinder.linkage.angle(cylinder.linkage.length(angle)) - angle)
        for cylinder in load_excavator().cylinders.values()
        for angle in np.linspace(cylinder.linkage.lower, cylinder.linkage.upper, 1001).tolist()
    )


def measured(case: Case) -> list[Row]:
    """All lines of one kind of tracks."""
    rows = on_level_ground(case)
    for degrees in (15.0, 25.0):
        rows += on_a_slope(case, degrees)
    rows += over_a_sill(case) + against_a_force(case)
    return [*rows, Row("joint to cylinder and back [rad]", round_trip(), 0, maximum=1e-9)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--model", choices=TRACK_MODELS, help="only this one")
    parser.add_argument("--soil", default="reference", help="kind of the ground, of soils.yaml")
    asked = parser.parse_args()
    models = (asked.model,) if asked.model else TRACK_MODELS
    soil = load_soil_types()[asked.soil].loose_soil
    tables = [measured(Case(model, soil)) for model in models]
    print(f"{'':<42}" + "".join(f"{model:>12} " for model in models))
    for rows in zip(*tables, strict=True):
        print(f"{rows[0].name:<42}" + "".join(f"{row!s:>13}" for row in rows))


if __name__ == "__main__":
    main()

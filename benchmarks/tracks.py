"""What tracks cost and how they drive: the fast ones beside the hinged ones.

Each model does the same on ground of one kind of soil, firm unless another is named: drives, stops,
stands, pivots, climbs and holds on slopes, and at last drives about at random on rough ground.
Prints a column for each: processor time per 5 ms step with the whole machine, and what it did. Run
from the repository root: `python benchmarks/tracks.py`; `--model physics` for one, `--soil loam`
for softer ground, `--minutes 10` to drive about for longer.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np
import pybullet
from numpy.typing import NDArray

from machine_sim.ground import Ground
from machine_sim.machine import MachineError, TrackedMachine, load_description
from machine_sim.machine.tracks import TRACK_MODELS, TrackModel
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils import load_soils

Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]

DT = 0.005
"""[s]"""

GRID = Grid(601, 601, 0.1)


class Site:
    """A machine on its ground."""

    def __init__(
        self, model: TrackModel, soil: LooseSoil, surface: Surface, x: float = 0.0
    ) -> None:
        across = np.arange(GRID.shape[0])
        heights = surface(*np.meshgrid(GRID.x(across), GRID.y(across), indexing="ij"))
        self.client = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(DT, self.client)
        pybullet.setGravity(0.0, 0.0, -9.81, self.client)
        moisture = np.full(GRID.shape, soil.moisture, dtype=np.uint8)
        ground = Ground(GRID, heights, soils=[soil], moisture=moisture)
        description = load_description(find_config("machines/excavator.yaml"))
        self.machine = TrackedMachine(description, self.client, ground, (x, 0.0), 0.0, model)
        self.steps, self.spent = 0, 0.0

    def drive(self, left: float, right: float, seconds: float) -> Array:
        """Drive with these speeds [m/s]; returns the places it was at [m], shape (n, 3)."""
        self.machine.command([0.0] * 4, [left, right])
        places = []
        for _ in range(round(seconds / DT)):
            began = time.process_time()
            self.machine.before_step(DT)
            pybullet.stepSimulation(self.client)
            self.machine.after_step()
            self.spent += time.process_time() - began
            places.append(self.machine.base_pose[0])
        self.steps += len(places)
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


def rough(seed: int) -> Surface:
    """Ground of 14 random waves, 0.15 m high in all."""
    rng = np.random.default_rng(seed)
    waves = [(*rng.normal(0.0, 0.6, 2), rng.uniform(0.0, 2.0 * math.pi)) for _ in range(14)]

    def surface(x: Array, y: Array) -> Array:
        heights = np.zeros_like(x)
        for kx, ky, phase in waves:
            heights += 0.05 * np.sin(kx * x + ky * y + phase) / (1.0 + 1.2 * math.hypot(kx, ky))
        return heights

    return surface


def way(places: Array) -> float:
    """Between the first and the last place [m]."""
    return float(np.linalg.norm(places[-1] - places[0]))


def on_level_ground(model: TrackModel, soil: LooseSoil) -> dict[str, str]:
    """Cost, sinkage, speed, stop, drift and pivot."""
    site = Site(model, soil, flat, -10.0)
    site.drive(0.0, 0.0, 2.0)
    sunk = site.machine.tracks.sinkage.mean()
    site.drive(0.8, 0.8, 2.0)
    site.steps, site.spent = 0, 0.0
    driven = way(site.drive(0.8, 0.8, 5.0))
    cost = 1e3 * site.spent / site.steps
    stop = site.drive(0.0, 0.0, 15.0)
    drift = way(site.drive(0.0, 0.0, 60.0))
    site.drive(-0.5, 0.5, 2.0)
    turned = 0.0
    for _ in range(20):
        before = site.heading
        site.drive(-0.5, 0.5, 0.4)
        turned += (site.heading - before + math.pi) % (2.0 * math.pi) - math.pi
    site.close()
    return {
        "cost, driving [ms a step]": f"{cost:.3f}",
        "sinkage, standing [mm]": f"{1e3 * sunk:.0f}",
        "speed, 0.8 asked for [m/s]": f"{driven / 5.0:.3f}",
        "way to a stop from there [mm]": f"{1e3 * np.ptp(stop[:200, 0]):.0f}",
        "drift, standing [mm/min]": f"{1e3 * drift:.2f}",
        "pivot, 0.42 without slip [rad/s]": f"{turned / 8.0:.3f}",
    }


def on_a_slope(model: TrackModel, soil: LooseSoil, degrees: float) -> dict[str, str]:
    """Climb and hold."""
    site = Site(model, soil, slope(degrees), -5.0)
    site.drive(0.0, 0.0, 2.0)
    climbed = way(site.drive(0.5, 0.5, 6.0))
    site.drive(0.0, 0.0, 2.0)
    crept = way(site.drive(0.0, 0.0, 10.0))
    site.close()
    return {
        f"climb, {degrees:g} deg, 0.5 asked for [m/s]": f"{climbed / 6.0:.3f}",
        f"creep, {degrees:g} deg [mm in 10 s]": f"{1e3 * crept:.1f}",
    }


def about(model: TrackModel, soil: LooseSoil, minutes: float, seed: int) -> dict[str, str]:
    """Random driving on rough ground."""
    site, rng = Site(model, soil, rough(seed)), np.random.default_rng(seed)
    speeds = ((0.8, 0.8), (-0.8, -0.8), (0.6, 0.2), (-0.4, 0.4), (0.0, 0.0), (1.5, 1.5))
    told, driven, share = "yes", 0.0, []
    try:
        while driven < 60.0 * minutes:
            left, right = speeds[rng.integers(len(speeds))]
            place, facing = site.machine.base_pose[0], site.heading
            if np.hypot(*place[:2]) > 20.0:  # back to the middle
                outward = place[0] * math.cos(facing) + place[1] * math.sin(facing)
                left = right = -0.8 if outward > 0.0 else 0.8
            lasts = rng.uniform(2.0, 5.0)
            went = way(site.drive(left, right, lasts))
            driven += lasts
            if left == right and left:
                share.append(went / abs(left * lasts))
    except MachineError as error:
        told = f"no, at {driven:.0f} s: {error}"
    cost = 1e3 * site.spent / site.steps
    site.close()
    return {
        f"sound after {minutes:g} min on rough ground": told,
        "way of what was asked for, median": f"{np.median(share):.2f}",
        "cost there [ms a step]": f"{cost:.3f}",
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--model", choices=TRACK_MODELS, help="only this one")
    parser.add_argument("--soil", default="reference", help="kind of the ground, of soils.yaml")
    parser.add_argument("--minutes", type=float, default=1.0, help="of random driving")
    parser.add_argument("--seed", type=int, default=1, help="of random driving")
    asked = parser.parse_args()
    models = (asked.model,) if asked.model else TRACK_MODELS
    soil = load_soils()[asked.soil].loose
    tables = []
    for model in models:
        table = on_level_ground(model, soil)
        for degrees in (15.0, 25.0):
            table |= on_a_slope(model, soil, degrees)
        tables.append(table | about(model, soil, asked.minutes, asked.seed))
    print(f"{'':<42}" + "".join(f"{model:>12}" for model in models))
    for name in tables[0]:
        print(f"{name:<42}" + "".join(f"{table[name]:>12}" for table in tables))


if __name__ == "__main__":
    main()

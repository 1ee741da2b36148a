"""Measure how the excavator drives with both track models, and the cost of a physics step.

    python -m benchmarks.driving_performance --model dynamic --soil loam

The machine drives, stops, stands, pivots, climbs and holds on slopes, drives over a sill, and
pulls against a force. Prints a column for each track model: CPU time of a step of the whole
machine, and the measured motion. A star marks a value outside its bounds; the bounds are for firm
ground. `random_digging` tests minutes of digging on rough ground.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
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
"""Physics step [s]."""

GRID = Grid(601, 601, 0.1)

PULL_FORCE = 50e3
"""Force against which the machine pulls [N]."""


@dataclass(frozen=True)
class Check:
    """A measured value and its bounds.

    Attributes:
        name: name of the quantity.
        unit: its unit.
        value: measured value.
        spec: format specification of the value.
        minimum: lower bound.
        maximum: upper bound.
    """

    name: str
    unit: str
    value: float
    spec: str = ".3f"
    minimum: float = -math.inf
    maximum: float = math.inf

    def __str__(self) -> str:
        is_within = self.minimum <= self.value <= self.maximum
        return f"{self.value:{self.spec}}{' ' if is_within else '*'}"


def load_excavator() -> MachineSpec:
    """Return the shipped excavator."""
    return load_machine_spec(find_config("machines/excavator.yaml"))


class Case(NamedTuple):
    """A track model on a soil."""

    model: TrackModel
    soil: LooseSoil


class Site:
    """The excavator on its ground.

    Attributes:
        client: physics client of pybullet.
        machine: the excavator.
        num_steps: number of physics steps since the counters were reset.
        cpu_time: CPU time of these steps [s].
    """

    def __init__(self, case: Case, surface: Surface, x: float = 0.0) -> None:
        cells = np.arange(GRID.rows)
        heights = surface(*np.meshgrid(GRID.x(cells), GRID.y(cells), indexing="ij"))
        self.client = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(DT, self.client)
        pybullet.setGravity(0.0, 0.0, -9.81, self.client)
        moisture = np.full(GRID.shape, case.soil.moisture, dtype=np.uint8)
        ground = Ground(GRID, heights, soils=[case.soil], moisture=moisture)
        self.machine = TrackedMachine(
            load_excavator(), self.client, ground, (x, 0.0), 0.0, case.model
        )
        self.reset_counters()

    def reset_counters(self) -> None:
        """Set the number of steps and the CPU time to 0."""
        self.num_steps, self.cpu_time = 0, 0.0

    def step(self) -> None:
        """Advance one physics step and add its CPU time."""
        start = time.process_time()
        self.machine.before_step(DT)
        pybullet.stepSimulation(self.client)
        self.machine.after_step()
        self.cpu_time += time.process_time() - start
        self.num_steps += 1

    def drive(self, left: float, right: float, seconds: float) -> Array:
        """Drive with given track speeds [m/s]; return the base positions [m], shape (n, 3)."""
        self.machine.command([0.0] * 4, [left, right])
        positions = []
        for _ in range(round(seconds / DT)):
            self.step()
            positions.append(self.machine.base_pose[0])
        return np.array(positions)

    @property
    def heading(self) -> float:
        """Yaw of the base [rad]."""
        x, y, z, w = self.machine.base_pose[1]
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def close(self) -> None:
        """Free the physics client."""
        pybullet.disconnect(self.client)


def flat(x: Array, y: Array) -> Array:
    """Return heights of level ground [m]."""
    return 0.0 * x


def slope(degrees: float) -> Surface:
    """Return a surface that rises along x by an angle [deg]."""
    return lambda x, y: math.tan(math.radians(degrees)) * x


def sill(x: Array, y: Array) -> Array:
    """Return heights of level ground with a sill [m] 0.15 m high and 0.6 m wide."""
    return np.where((x > 3.0) & (x < 3.6), 0.15, 0.0)


def distance(positions: Array) -> float:
    """Return the distance between the first and the last position [m]."""
    return float(np.linalg.norm(positions[-1] - positions[0]))


def drive_on_level_ground(case: Case) -> list[Check]:
    """Measure cost, speed, stopping distance, drift and pivot rate."""
    site = Site(case, flat, -10.0)
    site.drive(0.0, 0.0, 2.0)
    site.drive(0.8, 0.8, 2.0)
    site.reset_counters()
    driven = distance(site.drive(0.8, 0.8, 5.0))
    cost = 1e3 * site.cpu_time / site.num_steps
    stop = site.drive(0.0, 0.0, 15.0)
    drift = distance(site.drive(0.0, 0.0, 60.0))
    site.drive(-0.5, 0.5, 2.0)
    angle = 0.0
    for _ in range(20):
        before = site.heading
        site.drive(-0.5, 0.5, 0.4)
        angle += (site.heading - before + math.pi) % (2.0 * math.pi) - math.pi
    site.close()
    return [
        Check("CPU time of a step, driving", "ms", cost),
        Check("speed, 0.8 m/s commanded", "m/s", driven / 5.0, minimum=0.784, maximum=0.816),
        Check("stopping distance", "mm", 1e3 * float(np.ptp(stop[:200, 0])), ".1f", maximum=50.0),
        Check("drift, standing", "mm/min", 1e3 * drift, ".2f", maximum=1.0),
        Check("pivot rate, 0.42 rad/s without slip", "rad/s", angle / 8.0),
    ]


def climb_slope(case: Case, degrees: float) -> list[Check]:
    """Measure the speed up a slope, and the creep when the machine stands on it."""
    site = Site(case, slope(degrees), -5.0)
    site.drive(0.0, 0.0, 2.0)
    climbed = distance(site.drive(0.5, 0.5, 6.0))
    site.drive(0.0, 0.0, 2.0)
    creep = distance(site.drive(0.0, 0.0, 10.0))
    site.close()
    return [
        Check(f"climb, {degrees:g} deg, 0.5 m/s commanded", "m/s", climbed / 6.0),
        Check(f"creep in 10 s, {degrees:g} deg", "mm", 1e3 * creep, ".2f"),
    ]


def drive_over_sill(case: Case) -> list[Check]:
    """Measure the largest motion of an arm joint that is commanded to stand."""
    site = Site(case, sill)
    site.drive(0.0, 0.0, 2.0)
    initial = site.machine.joint_positions
    site.machine.command([0.0] * 4, [0.8, 0.8])
    deviation = 0.0
    for _ in range(round(7.0 / DT)):
        site.step()
        change = np.abs(site.machine.joint_positions - initial).max()
        deviation = max(deviation, float(change))
    site.close()
    return [Check("arm joint, over a 0.15 m sill", "mrad", 1e3 * deviation, maximum=0.1)]


def pull_force(case: Case) -> list[Check]:
    """Measure the speed against a force on the tool, and the balance of ground force and pull."""
    site = Site(case, flat, -15.0)
    forces: list[Array] = []
    positions: list[Array] = []
    site.machine.command([0.0] * 4, [0.8, 0.8])
    for k in range(round(13.0 / DT)):
        site.machine.tool.push([-PULL_FORCE, 0.0, 0.0], [0.0, 0.0, 0.0])
        site.step()
        if k * DT >= 3.0:
            forces.append(site.machine.tracks.wrench[:3].copy())
            positions.append(site.machine.base_pose[0])
    error = abs(float(np.mean(forces, axis=0)[0]) / PULL_FORCE - 1.0)
    site.close()
    return [
        Check("speed against 50 kN", "m/s", distance(np.array(positions)) / 10.0),
        Check("ground force minus 50 kN", "%", 100.0 * error, ".2f", maximum=5.0),
    ]


def linkage_error() -> float:
    """Return the largest error [rad] from joint angle to cylinder length and back."""
    return max(
        float(abs(cylinder.linkage.angle(cylinder.linkage.length(angle)) - angle))
        for cylinder in load_excavator().cylinders.values()
        for angle in np.linspace(cylinder.linkage.lower, cylinder.linkage.upper, 1001).tolist()
    )


def measure_case(case: Case) -> list[Check]:
    """Measure all quantities of one track model."""
    checks = drive_on_level_ground(case)
    for degrees in (15.0, 25.0):
        checks += climb_slope(case, degrees)
    checks += drive_over_sill(case) + pull_force(case)
    error = Check("joint angle to cylinder and back", "rad", linkage_error(), ".1e", maximum=1e-9)
    return [*checks, error]


def main() -> None:
    """Measure and print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("--model", choices=TRACK_MODELS, help="only this track model")
    parser.add_argument("--soil", default="reference", help="name of a soil in config/soils.yaml")
    options = parser.parse_args()
    models = (options.model,) if options.model else TRACK_MODELS
    soil = load_soil_types()[options.soil].loose_soil
    table = ResultTable([Column(name) for name in models], as_json=options.json, row_width=44)
    table.print_note(describe_load())
    tables = [measure_case(Case(model, soil)) for model in models]
    table.print_header()
    for checks in zip(*tables, strict=True):
        name = checks[0].name if options.json else f"{checks[0].name} [{checks[0].unit}]"
        values = [check.value for check in checks]
        table.print_row(name, values, texts=[str(check) for check in checks], unit=checks[0].unit)


if __name__ == "__main__":
    main()

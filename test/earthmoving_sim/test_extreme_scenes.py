"""At the floor of the terrain, at the edge of the map, over a cliff, on rock: no soil is lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.machine_scenes import excavator, machine_on_level_ground

from earthmoving_sim.world import World
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.physics_engine import pybullet
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.sweep_limits import SweepLimits

EXCAVATOR = excavator()
GRID = Grid(81, 81, 0.2)
ATTITUDE = 1.2
"""Initial attitude of the bucket [rad]: its floor descends toward the lip."""
CUT, CURL, LIFT = (0.0, 0.3, 1.0, 0.3), (0.0, 0.0, 1.0, 1.0), (0.0, -1.0, 0.0, 0.0)
LOWER, REACH_OUT, OPEN = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.0, 0.0, 0.0, -1.0)
REST = (0.0, 0.0, 0.0, 0.0)


class Digger:
    """An excavator, facing +x, whose levers are held; every tick must balance.

    Attributes:
        sim: the machine.
        world: soil and machine.
        lowest: lowest height of a key point of the bucket so far [m].
        max_fill: maximum fill of the bucket so far, in heaped capacities.
    """

    def __init__(
        self,
        heights: NDArray[np.float64],
        *,
        x: float = 0.0,
        reach: float | None = 6.8,
        soil_depth: float = 20.0,
        soil: str = "loam",
    ) -> None:
        """
        Args:
            heights: terrain [m], shape of `GRID`.
            x: position of the machine [m].
            reach: initial distance of the lip from the swing axis [m]; None: as its file has it.
            soil_depth: depth of the floor below the lowest height [m].
            soil: kind of soil.
        """
        ground = Soil(GRID, heights, SoilParams(soil=soil, soil_depth=soil_depth))
        spec = EXCAVATOR
        if reach is not None:
            height = 0.2 - arm_geometry(EXCAVATOR).swing[2]
            angles = solve_arm_angles(EXCAVATOR, reach, height, ATTITUDE)
            spec = replace(EXCAVATOR, home=np.array([0.0, *angles]))
        self.sim = MachineSim(
            [Placement(spec, (x, 0.0))],
            GRID,
            ground.columns.height,
            soils=ground.loose_soils,
            soil=ground.columns.top_soil,
            moisture=ground.columns.top_moisture,
        )
        self.world = World(ground, {1: self.sim})
        self.lowest, self.max_fill = np.inf, 0.0
        self._velocities = np.array([spec.joints[name].max_velocity for name in spec.joint_names])

    def hold(
        self, levers: tuple[float, ...], seconds: float, tracks: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Hold levers, -1 to 1 for each joint, and track speeds [m/s]."""
        self.sim.command(self._velocities * levers, np.array(tracks))
        for _ in range(round(seconds / self.sim.params.tick_period)):
            assert self.world.step().imbalance == 0
            self.lowest = min(self.lowest, self.sim.tool_coupling.key_points_at(0)[:, 2].min())
            self.max_fill = max(self.max_fill, self.sim.payload.fill)

    def check(self) -> None:
        """Assert that soil was dug and none was lost, neither in the terrain nor by tunnelling."""
        assert self.max_fill > 0.5
        assert self.world.soil.verify_volume()
        particles = self.sim.particles
        assert particles.num_plate_tunnellings == particles.num_ground_tunnellings == 0


@pytest.fixture
def make_digger() -> Iterator[Callable[..., Digger]]:
    """Return a function that makes a `Digger`; all worlds are closed after the test."""
    diggers = []

    def make(*args: object, **options: object) -> Digger:
        diggers.append(Digger(*args, **options))  # type: ignore[arg-type]
        return diggers[-1]

    yield make
    for digger in diggers:
        digger.world.close()


def test_bucket_cannot_dig_below_the_floor_of_the_terrain(make_digger) -> None:
    digger = make_digger(np.zeros(GRID.shape), soil_depth=0.3)
    for levers in (LOWER, CUT, CURL, LIFT, OPEN, LOWER):
        digger.hold(levers, 1.5)
    columns = digger.world.soil.columns
    assert np.count_nonzero(columns.firm + columns.loose == 0) > 5, "the floor was laid bare"
    assert columns.height.min() == columns.floor == pytest.approx(-0.3)
    # Full levers lift the machine on its bucket. In soil of any depth the lip is 1.5 m deep then.
    assert columns.floor - 0.3 < digger.lowest < columns.floor
    digger.check()


def test_digging_across_the_edge_of_the_map_books_what_falls_off(make_digger) -> None:
    digger = make_digger(np.zeros(GRID.shape), x=1.6)
    assert digger.sim.tool_coupling.key_points_at(0)[:, 0].max() > GRID.x(0), "beyond the edge"
    for levers in (LOWER, CUT, CURL, LIFT, REACH_OUT, OPEN, LOWER, CUT, LIFT, OPEN, REST):
        digger.hold(levers, 1.5)
    ledger = digger.world.ledger
    assert ledger.outside > 10_000_000
    digger.check()


def test_loaded_machine_that_rolls_over_a_cliff_loses_no_soil(make_digger) -> None:
    x, y = GRID.x(np.arange(81))[:, None], GRID.y(np.arange(81))[None, :]
    cliff = np.where(y < -1.9 + 0.25 * np.maximum(x - 1.5, 0.0), -4.0, 0.0)
    digger = make_digger(cliff, x=-3.0, reach=5.0)
    for levers, seconds in ((LOWER, 1.2), (CUT, 2.0), (CURL, 2.0), (LIFT, 0.7)):
        digger.hold(levers, seconds)
    assert digger.sim.payload.fill > 0.5
    digger.hold(REST, 8.0, tracks=(1.5, 1.5))
    digger.hold(REST, 3.0)
    assert digger.sim.machine.overturned
    assert digger.sim.payload.fill < 0.1
    digger.check()


def test_sweeps_of_a_machine_that_overturns_are_accepted() -> None:
    sim = machine_on_level_ground()
    body, client = sim.machine.body, sim.machine.client_id
    on_its_side = pybullet.getQuaternionFromEuler((1.2, 0.0, 0.0))
    pybullet.resetBasePositionAndOrientation(body, (0.0, 0.0, 3.0), on_its_side, client)
    sim.step()  # the sweep of this tick is the jump to the pose above
    limits, messages = SweepLimits(20.0 * sim.params.tick_period), []
    has_touched = False
    for tick in range(150):
        sweeps = sim.step().sweeps
        messages += limits.check(tick, sweeps)[1]
        has_touched |= bool(sim.machine.tracks.shoe_loads.any())
    is_overturned = sim.machine.overturned
    sim.close()
    assert is_overturned
    assert has_touched
    assert not messages


def test_machine_that_falls_on_its_bucket_does_not_dig_into_rock(make_digger) -> None:
    digger = make_digger(np.zeros(GRID.shape), reach=None, soil="rock")
    digger.hold((0.0, 0.11, -0.6, 0.0), 3.0)
    digger.hold((0.0, 0.29, 0.0, 0.0), 3.5)
    assert digger.sim.machine.tilt > 0.3, "it stands on its bucket"
    digger.hold((0.0, 0.0, 0.6, 0.15), 5.5)  # the bucket rolls under it, and it falls
    assert digger.sim.machine.tilt < 0.1
    assert digger.lowest > -0.15
    assert digger.world.soil.columns.height.min() > -0.15
    assert digger.world.ledger.start - digger.world.ledger.terrain < 0.05e9

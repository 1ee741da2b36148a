"""Scoops at maximum joint speeds: no particle tunnels, and no soil is lost."""

import numpy as np
import pytest
from support.machine_scenes import machine_on_level_ground
from support.particle_scenes import LITRE, cloud, square

from benchmarks.validation.full_speed_scoop import ScoopResult, run_scoop
from benchmarks.validation.plate_tunnelling import PlateSet, TunnellingMonitor, sweep_plate

UP = np.array([0.0, 0.0, 1.0])


def check(result: ScoopResult) -> None:
    """Assert that a scoop dug with every joint close to its maximum speed and lost nothing."""
    assert result.max_dug_volume > 0.05
    assert result.max_in_bucket > 50
    assert result.joint_speed_ratios.min() > 0.9
    assert result.max_tip_speed > 3.0
    assert result.max_particle_speed > 1.5
    assert result.num_plate_tunnellings == result.num_ground_tunnellings == 0
    assert result.num_crossings == 0
    assert result.imbalance == 0
    assert result.is_consistent


def test_two_scoops_at_maximum_speed_lose_nothing():
    for seed in (15, 89):
        check(run_scoop(seed))


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.timeout(1200)
def test_many_scoops_at_maximum_speed_lose_nothing():
    scoops = [run_scoop(seed) for seed in range(30)]
    for result in scoops:
        check(result)
    assert max(result.max_tip_speed for result in scoops) > 10.0
    assert max(result.max_particle_speed for result in scoops) > 7.0
    assert sum(result.max_in_bucket > 700 for result in scoops) >= 5, "full buckets"


PATHS = {
    "down through the plate": ([0.2, 0.1, 0.3], [0.3, 0.0, -0.3], True),
    "up through it": ([0.2, 0.1, -0.01], [0.2, 0.1, 0.01], True),
    "past its edge": ([0.49, 0.0, 0.3], [0.59, 0.0, -0.3], False),
    "along it": ([-2.0, 0.1, 0.1], [2.0, 0.1, 0.1], False),
    "towards it": ([0.2, 0.1, 0.3], [0.2, 0.1, 0.01], False),
    "far from it": ([0.2, 3.0, 0.3], [0.2, 3.0, -0.3], False),
}


@pytest.mark.parametrize("orientation", [1, -1])
@pytest.mark.parametrize("path", PATHS)
def test_path_through_a_plate_is_a_crossing(path, orientation):
    before, after, is_crossing = PATHS[path]
    plates = PlateSet([square(0.5)[::orientation], square(0.5) + 5.0 * UP])
    assert plates.find_crossings(np.array([before]), np.array([after])).tolist() == [is_crossing]


@pytest.mark.parametrize("radius", [0.003, 0.012, 0.021])
@pytest.mark.parametrize("speed", [11.0, 22.0])
def test_no_small_particle_passes_a_fast_plate(radius, speed):
    assert sweep_plate(radius, speed) == 0


@pytest.mark.parametrize("has_plates", [True, False])
def test_monitor_finds_crossings_that_the_engine_cannot_count(has_plates):
    machine = machine_on_level_ground()
    engine, bucket = machine.particles, machine.machine.spec.bucket
    monitor = TunnellingMonitor(machine)
    rotation, pin = machine.machine.tool.pose
    if not has_plates:  # the engine has a plate far away instead of the bucket
        engine.remove_tool(0)
        engine.add_tool(0, [square(0.1) + 50.0 * UP], (rotation, pin))
    x, z = bucket.profile.mean(axis=0)
    points = cloud(60, 0.13, (0.5, 0.5), -0.2) + pin + rotation @ [x, 0.0, z]
    engine.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    for _ in range(60):
        machine.step()
    machine.close()
    assert engine.num_plate_tunnellings == 0
    assert monitor.max_in_bucket > 30
    assert (monitor.num_crossings == 0) == has_plates
    assert (monitor.num_crossings > 30) != has_plates

"""Scoops as fast as the machine can: no particle goes through anything, no soil is lost."""

import numpy as np
import pytest
from support.machine_scenes import machine_on_level_ground
from support.particle_scenes import LITRE, cloud, square

from benchmarks.validation.full_speed_scoop import ScoopResult, run_scoop
from benchmarks.validation.plate_tunnelling import PlateSet, TunnellingMonitor

UP = np.array([0.0, 0.0, 1.0])


def check(found: ScoopResult) -> None:
    """A scoop really dug, as fast as every joint can, and lost nothing."""
    assert found.max_dug_volume > 0.05
    assert found.max_in_bucket > 50
    assert found.joint_speed_ratios.min() > 0.99
    assert found.max_tip_speed > 3.0
    assert found.max_particle_speed > 1.5
    assert found.tunnelled == found.num_sunk == found.count_tunnelled == 0
    assert found.imbalance == 0
    assert found.is_consistent


def test_two_scoops_at_top_speed():
    for seed in (15, 89):
        check(run_scoop(seed))


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_hundred_scoops_at_top_speed():
    scoops = [run_scoop(seed) for seed in range(100)]
    for found in scoops:
        check(found)
    assert max(found.max_tip_speed for found in scoops) > 10.0
    assert max(found.max_particle_speed for found in scoops) > 7.0
    assert sum(found.max_in_bucket > 700 for found in scoops) >= 5, "full buckets"
    assert sum(found.max_locked_particles > 100 for found in scoops) >= 3, "loads that came to rest"


WAYS = {
    "down through the plate": ([0.2, 0.1, 0.3], [0.3, 0.0, -0.3], True),
    "up through it": ([0.2, 0.1, -0.01], [0.2, 0.1, 0.01], True),
    "past its edge": ([0.49, 0.0, 0.3], [0.59, 0.0, -0.3], False),
    "along it": ([-2.0, 0.1, 0.1], [2.0, 0.1, 0.1], False),
    "towards it": ([0.2, 0.1, 0.3], [0.2, 0.1, 0.01], False),
    "far from it": ([0.2, 3.0, 0.3], [0.2, 3.0, -0.3], False),
}


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("way", WAYS)
def test_a_way_through_a_plate_is_seen(way, turn):
    before, after, through = WAYS[way]
    shell = PlateSet([square(0.5)[::turn], square(0.5) + 5.0 * UP])
    assert shell.count_tunnelled(np.array([before]), np.array([after])).tolist() == [through]


@pytest.mark.parametrize("blind", [False, True])
def test_the_watch_sees_what_the_engine_is_blind_to(blind):
    machine = machine_on_level_ground()
    engine, bucket = machine.particles, machine.machine.spec.bucket
    watch = TunnellingMonitor(machine)
    rotation, pin = machine.machine.tool.pose
    if blind:
        engine.remove_tool(0)
        engine.add_tool(0, [square(0.1) + 50.0 * UP], (rotation, pin))
    x, z = bucket.profile.mean(axis=0)
    points = cloud(60, 0.13, (0.5, 0.5), -0.2) + pin + rotation @ [x, 0.0, z]
    engine.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    for _ in range(60):
        machine.step()
    machine.close()
    assert engine.num_plate_tunnellings == 0
    assert watch.max_in_bucket > 30
    assert (watch.count_tunnelled > 30) == blind
    assert (watch.count_tunnelled == 0) != blind

"""TerrainSurvey: where to dig, how high to swing and to dump."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine
from support.operator_scenes import ARM, MACHINE, cone, flat, lip, observation, tilted

from dig_operator import BehaviourParams
from dig_operator.observed_machine import ObservedMachine
from dig_operator.terrain_survey import TerrainSurvey

PARAMS = BehaviourParams()
SURVEY = TerrainSurvey(ARM, PARAMS, MACHINE.bucket)
DIG, DUMP = 0.0, math.pi / 2


def heap_at(azimuth: float, height: float):
    """Return a heap on the path of the bucket, `azimuth` [rad] from the dig."""
    r = PARAMS.dump_radius
    return cone(r * math.cos(azimuth), r * math.sin(azimuth), height)


@pytest.mark.parametrize("sector_azimuth", [0.0, 2.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_azimuth_is_on_the_higher_side_of_the_sector(sector_azimuth, side):
    def rises_sideways(x, y):
        return side * 0.2 * (y * math.cos(sector_azimuth) - x * math.sin(sector_azimuth))

    observed = observation(surface=rises_sideways)
    azimuth = SURVEY.highest_ground_azimuth(observed, sector_azimuth)
    assert azimuth == pytest.approx(sector_azimuth + side * PARAMS.dig_sector_half_width)


def test_azimuth_is_the_middle_of_the_sector_on_level_ground():
    assert SURVEY.highest_ground_azimuth(observation(), 0.7) == 0.7


def swing_heights(observed, start=DIG, end=DUMP):
    return SURVEY.swing_clearance_heights(observed, start, end, ARM.depth_below_pin)


def test_swing_over_level_ground_keeps_its_clearance():
    assert swing_heights(observation()) == pytest.approx(ARM.depth_below_pin + PARAMS.clearance)


@pytest.mark.parametrize("azimuth", [0.0, 0.8, DUMP])
def test_swing_clears_a_heap_on_its_path_and_is_low_elsewhere(azimuth):
    heights = swing_heights(observation(surface=heap_at(azimuth, 1.5)))
    assert heights.max() - ARM.depth_below_pin >= 1.5 + 0.8 * PARAMS.clearance
    highest = np.flatnonzero(heights == heights.max())
    azimuths = np.linspace(DIG, DUMP, heights.size)
    assert np.abs(azimuths[highest] - azimuth).min() < 0.2
    assert heights.min() == pytest.approx(ARM.depth_below_pin + PARAMS.clearance, abs=0.3)


def test_swing_ignores_a_heap_beside_its_path():
    observed = observation(surface=heap_at(-0.5 * math.pi, 2.0))
    assert (swing_heights(observed) == swing_heights(observation())).all()


def test_swing_takes_the_shorter_direction():
    assert swing_heights(observation(surface=heap_at(math.pi, 2.0)), 3.0, -3.0).max() > 2.0
    assert swing_heights(observation(surface=heap_at(0.0, 2.0)), 3.0, -3.0).max() < 2.0


def truck_at(x: float, y: float) -> ObservedMachine:
    spec = load_shipped_machine("dumper")
    return ObservedMachine("truck", spec, np.array([x, y, 0.0]), tilted(yaw=math.pi), spec.home)


def test_swing_and_dump_clear_another_machine():
    observed = replace(observation(), others=(truck_at(0.0, 5.8),))
    heights = swing_heights(observed)
    bed = heights[-1] - ARM.depth_below_pin
    assert 1.8 < bed - PARAMS.clearance < 2.2, "the bed; the cab is beside the path"
    assert swing_heights(observed, DIG, 2.2).max() > heights[-1] + 0.05, "over the cab"
    pin = SURVEY.dump_clearance_height(observed, DUMP, PARAMS.dump_radius)
    assert pin - MACHINE.bucket.tip_radius > 1.8 + PARAMS.clearance
    beyond = replace(observation(), others=(truck_at(0.0, 14.0),))
    assert (swing_heights(beyond) == swing_heights(observation())).all()


def test_opening_bucket_clears_the_heap_below_it():
    for height in (0.0, 0.5, 1.0, 1.5):
        observed = observation(surface=heap_at(DUMP, height))
        pin = SURVEY.dump_clearance_height(observed, DUMP, PARAMS.dump_radius)
        min_height = pin - MACHINE.bucket.tip_radius
        assert min_height - height == pytest.approx(PARAMS.clearance, abs=0.15)


def test_reach_on_level_ground_is_that_of_the_parameters():
    dig_reach = SURVEY.dig_reach(
        observation(position=(0.0, 0.0, 0.4)), DIG, ARM.attitude_for_attack_angle(0.45)
    )
    assert (dig_reach.min_radius, dig_reach.max_radius) == (PARAMS.min_radius, PARAMS.max_radius)
    assert dig_reach.min_height == pytest.approx(0.4 - PARAMS.max_dig_depth)
    assert (dig_reach.width, dig_reach.max_cut_depth) == (
        MACHINE.bucket.width,
        PARAMS.max_cut_depth,
    )


@pytest.mark.parametrize("surface", [flat, lambda x, y: -0.25 * x, lambda x, y: 0.3 * x])
def test_lip_reaches_the_ground_at_the_maximum_radius(surface):
    long_reach = replace(PARAMS, max_radius=12.0)
    observed = observation(surface=surface)
    entry = ARM.attitude_for_attack_angle(PARAMS.entry_angle)
    max_radius = (
        TerrainSurvey(ARM, long_reach, MACHINE.bucket).dig_reach(observed, DIG, entry).max_radius
    )
    assert 6.5 < max_radius < 10.0
    ground = float(surface(np.array([max_radius]), np.zeros(1))[0])
    for offset in (PARAMS.clearance, -PARAMS.max_cut_depth):
        position = lip(
            observed,
            ARM.joint_angles(
                observed, ARM.pose_with_lip_at(DIG, max_radius, ground + offset, entry)
            ),
        )
        assert position[0] == pytest.approx(
            max_radius, abs=0.31
        )  # the most by which a pin is moved inward
        assert position[2] == pytest.approx(ground + offset)

"""What an operator takes from the terrain: where to dig, how high to swing and to dump."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.operator_scenes import ARM, MACHINE, cone, flat, lip, observation

from dig_operator import BehaviourParams
from dig_operator.terrain_survey import TerrainSurvey

PARAMS = BehaviourParams()
SURVEY = TerrainSurvey(ARM, PARAMS, MACHINE.bucket)
DIG, DUMP = 0.0, math.pi / 2


def heap_at(azimuth: float, height: float):
    """A heap where the bucket passes over, `azimuth` [rad] from the dig."""
    r = PARAMS.dump_radius
    return cone(r * math.cos(azimuth), r * math.sin(azimuth), height)


@pytest.mark.parametrize("middle", [0.0, 2.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_operator_digs_on_the_side_that_is_higher(middle, side):
    def rises_sideways(x, y):
        return side * 0.2 * (y * math.cos(middle) - x * math.sin(middle))

    chosen = SURVEY.highest_ground_azimuth(observation(surface=rises_sideways), middle)
    assert chosen == pytest.approx(middle + side * PARAMS.dig_sector_half_width)


def test_operator_digs_straight_ahead_where_the_ground_is_even():
    assert SURVEY.highest_ground_azimuth(observation(), 0.7) == 0.7


def test_swing_over_level_ground_keeps_its_clearance():
    height = SURVEY.swing_clearance_height(observation(), DIG, DUMP)
    assert height == pytest.approx(ARM.depth_below_pin + PARAMS.clearance)


@pytest.mark.parametrize("azimuth", [0.0, 0.8, DUMP])
def test_swing_clears_a_heap_on_its_way(azimuth):
    height = SURVEY.swing_clearance_height(observation(surface=heap_at(azimuth, 1.5)), DIG, DUMP)
    assert height - ARM.depth_below_pin >= 1.5 + 0.8 * PARAMS.clearance


def test_swing_does_not_rise_for_a_heap_that_is_not_on_its_way():
    seen = observation(surface=heap_at(-0.5 * math.pi, 2.0))
    assert SURVEY.swing_clearance_height(seen, DIG, DUMP) == SURVEY.swing_clearance_height(
        observation(), DIG, DUMP
    )


def test_swing_looks_the_short_way_around():
    seen = observation(surface=heap_at(math.pi, 2.0))
    assert SURVEY.swing_clearance_height(seen, 3.0, -3.0) > 2.0
    assert SURVEY.swing_clearance_height(observation(surface=heap_at(0.0, 2.0)), 3.0, -3.0) < 2.0


def test_open_bucket_clears_the_heap_that_it_dumps_on():
    for height in (0.0, 0.5, 1.0, 1.5):
        pin = SURVEY.dump_clearance_height(observation(surface=heap_at(DUMP, height)), DUMP)
        min_height = pin - MACHINE.bucket.tip_radius
        assert min_height - height == pytest.approx(PARAMS.clearance, abs=0.15)


def test_reach_on_level_ground_is_what_the_operator_wants():
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
def test_lip_can_be_put_on_the_ground_at_the_far_end_of_the_reach(surface):
    greedy = replace(PARAMS, max_radius=12.0)
    seen = observation(surface=surface)
    entry = ARM.attitude_for_attack_angle(PARAMS.entry_angle)
    max_radius = TerrainSurvey(ARM, greedy, MACHINE.bucket).dig_reach(seen, DIG, entry).max_radius
    assert 6.5 < max_radius < 10.0
    ground = float(surface(np.array([max_radius]), np.zeros(1))[0])
    for above in (PARAMS.clearance, -PARAMS.max_cut_depth):
        at = lip(
            seen,
            ARM.joint_angles(seen, ARM.pose_with_lip_at(DIG, max_radius, ground + above, entry)),
        )
        assert at[0] == pytest.approx(max_radius, abs=0.31)  # as far as a pin may be pulled in
        assert at[2] == pytest.approx(ground + above)

"""plan_dig: a path of the lip that sweeps a given volume."""

from dataclasses import replace

import numpy as np
import pytest

from dig_operator.dig_plan import DigPlan, DigReach, plan_dig

REACH = DigReach(min_radius=4.4, max_radius=7.3, min_height=-3.0, width=1.2, max_cut_depth=0.45)
RADIUS = np.arange(3.9, 7.8, 0.1)
LEVEL = np.zeros(RADIUS.size)


def depth(plan: DigPlan, surface: np.ndarray = LEVEL) -> np.ndarray:
    """Return the depth of the lip below the surface [m] at each waypoint."""
    return np.interp(plan.radius, RADIUS, surface) - plan.height


@pytest.mark.parametrize("volume", [0.3, 0.6, 1.0])
def test_plan_sweeps_the_requested_volume(volume):
    assert plan_dig(RADIUS, LEVEL, REACH, volume).volume == pytest.approx(volume, rel=0.1)


def test_volume_lies_between_surface_and_path():
    plan = plan_dig(RADIUS, LEVEL, REACH, 0.8)
    section = np.trapezoid(depth(plan)[::-1], plan.radius[::-1])
    assert plan.volume == pytest.approx(section * REACH.width, rel=0.02)


def test_plan_limits_its_depth_and_then_sweeps_less():
    plan = plan_dig(RADIUS, LEVEL, REACH, 5.0)
    assert depth(plan).max() == pytest.approx(REACH.max_cut_depth)
    assert plan.volume < 0.45 * REACH.width * (REACH.max_radius - REACH.min_radius)


def test_plan_stays_above_the_minimum_height():
    plan = plan_dig(RADIUS, LEVEL, replace(REACH, min_height=-0.2), 1.0)
    assert plan.height.min() == pytest.approx(-0.2)


def test_ground_below_the_minimum_height_is_not_cut():
    plan = plan_dig(RADIUS, LEVEL - 1.0, replace(REACH, min_height=-0.2), 1.0)
    assert plan.volume == 0.0
    assert (plan.height == -1.0).all()


def test_lip_moves_inward_and_enters_and_leaves_at_the_surface():
    plan = plan_dig(RADIUS, LEVEL, REACH, 0.8)
    assert (np.diff(plan.radius) < 0).all()
    assert plan.radius[0] <= REACH.max_radius
    assert plan.radius[-1] >= REACH.min_radius
    assert plan.height[[0, -1]] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("rise", [-0.2, 0.2])
def test_plan_follows_the_slope_of_the_ground(rise):
    plan = plan_dig(RADIUS, rise * RADIUS, REACH, 0.8)
    depths = depth(plan, rise * RADIUS)
    assert np.isclose(depths, depths.max()).mean() > 0.5


@pytest.mark.parametrize(("pit", "undug"), [((4.0, 7.5), (7.5, 11.0)), ((7.5, 11.0), (4.0, 7.5))])
def test_plan_prefers_undug_ground_over_a_pit(pit, undug):
    radius = np.arange(3.5, 11.5, 0.1)
    surface = np.where((radius >= pit[0]) & (radius <= pit[1]), -0.8, 0.0)
    plan = plan_dig(radius, surface, replace(REACH, min_radius=4.0, max_radius=11.0), 0.7)
    assert undug[0] < plan.radius.mean() < undug[1]
    assert plan.height.mean() > -0.5


def test_reach_shorter_than_a_drag_is_dug_over_its_length():
    plan = plan_dig(RADIUS, LEVEL, replace(REACH, max_radius=REACH.min_radius + 0.9), 0.2)
    assert plan.radius[[0, -1]] == pytest.approx([5.3, 4.4])
    assert plan.volume == pytest.approx(0.2, rel=0.1)


def test_surface_known_at_one_point_is_extended_level():
    plan = plan_dig(np.array([5.0]), np.array([1.0]), REACH, 0.6)
    assert plan.volume == pytest.approx(0.6, rel=0.1)
    assert plan.height.max() == pytest.approx(1.0)


def test_empty_plan_has_no_waypoints_and_no_volume():
    plan = DigPlan.without_waypoints()
    assert (plan.radius.size, plan.height.size, plan.volume) == (0, 0, 0.0)

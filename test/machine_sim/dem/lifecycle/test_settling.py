"""Settled particles: those that can be deposited as terrain."""

import numpy as np
from support.particle_scenes import LITRE, box, engine, pose, run, square

RADIUS = 0.0561
"""Radius of a particle of one litre [m]."""
AT_REST = np.zeros((1, 3))


def test_particle_at_rest_on_the_ground_settles_after_the_settle_time():
    world = engine(settle_time=0.2)
    ids = world.add([[0, 0, 0.055]], AT_REST, LITRE, grow=False)
    run(world, 0.1)
    assert world.settled().size == 0
    run(world, 0.2)
    np.testing.assert_array_equal(world.settled(), ids)


def test_moving_or_airborne_particle_does_not_settle():
    world = engine(ground_friction=0.0)
    world.add([[0, 0, 0.056], [0, 1, 3.0]], [[1.0, 0, 0], [0, 0, 0]], LITRE, grow=False)
    run(world, 0.3)
    assert world.settled().size == 0


def test_settle_time_starts_again_when_a_particle_is_hit():
    world = engine()
    ids = world.add([[0, 0, 0.056]], AT_REST, LITRE, grow=False)
    run(world, 0.3)
    np.testing.assert_array_equal(world.settled(), ids)
    world.add([[-2.1 * RADIUS, 0, 0.056]], [[3.0, 0, 0]], LITRE, grow=False)
    run(world, 0.03)
    assert world.settled().size == 0


def test_only_the_lowest_particle_of_a_stack_lands():
    world = engine()
    ids = world.add([[0, 0, RADIUS], [0, 0, 3 * RADIUS]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 0.3)
    np.testing.assert_array_equal(world.settled(), ids[:1])


def test_particles_at_or_in_a_tool_do_not_land():
    world = engine()
    world.add_tool(0, box(1.0, 1.0, 0.6), pose(0, 0, 0.0))
    world.add_tool(1, [square(0.3)], pose(3.0, 0, 0.2, np.pi / 2))
    world.add([[0.0, 0, 0.06], [3.06, 0, 0.056]], np.zeros((2, 3)), LITRE, grow=False)
    free = world.add([[3.5, 0, 0.056]], AT_REST, LITRE, grow=False)
    run(world, 0.3)
    np.testing.assert_array_equal(world.settled(), free)


def test_frozen_particle_does_not_settle_again():
    world = engine()
    ids = world.add([[0, 0, 0.056], [1, 0, 0.056]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 0.3)
    world.freeze(ids[:1])
    np.testing.assert_array_equal(world.settled(), ids[1:])


def test_particle_off_the_map_settles_at_any_speed():
    world = engine()
    ids = world.add([[7.9, 0, 1.0]], [[9.0, 0, 0]], LITRE, grow=False)
    assert world.settled().size == 0
    run(world, 0.05)
    np.testing.assert_array_equal(world.settled(), ids)


def test_settled_ids_ascend_after_rows_were_sorted():
    world = engine()
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-6, 6, (300, 2)), np.full(300, 0.045)])
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    world.sort_rows()
    run(world, 0.2)
    ids = world.settled()
    assert (np.diff(world.ids.astype(int)) < 0).any(), "the order of rows did not change"
    assert ids.size > 250
    assert (np.diff(ids.astype(int)) > 0).all()

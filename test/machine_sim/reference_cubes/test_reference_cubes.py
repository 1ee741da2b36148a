"""Soil as rigid cubes in pybullet: on the terrain, in tools, with velocity clamps."""

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, box, cloud, cubes, drive, pose, run, square

from machine_sim.dem import ParticleError
from machine_sim.reference_cubes import VelocityClamps
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(swell=0.25)
EDGE = np.cbrt(1.25e-3)
HALF = 0.5 * EDGE
UNCLAMPED = VelocityClamps(enabled=False)
THREE = np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0.2, 1.0]])


def filled_box(z=1.0, **options):
    """Return 40 half-litre cubes at rest in a half-metre box in the air."""
    world = cubes(**options)
    world.add_tool(0, box(0.5, 0.5, 0.5), pose(z=z))
    points = cloud(40, 0.1, (0.35, 0.35), z + 0.05)
    world.add(points, np.zeros_like(points), LITRE // 2)
    run(world, 1.0)
    return world


def fraction_inside(world):
    """Return the fraction of the cubes in the box and in the heap on it."""
    x, y, z = world.positions_in_tool_frame(0).T
    return float(np.mean((np.abs(x) < 0.25) & (np.abs(y) < 0.25) & (z > 0.0) & (z < 0.6)))


@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_cubes_come_to_rest_on_the_ground(slope):
    world = cubes(slope=slope)
    points = np.array([[x, y, slope * x + 0.3] for x in (-2, 0, 1) for y in (-1, 0.1, 2)])
    world.add(points, np.zeros((9, 3)), LITRE)
    run(world, 1.0)
    before = world.positions.copy()
    run(world, 0.5)
    x, _, z = world.positions.T
    np.testing.assert_allclose((z - slope * x) / np.hypot(1.0, slope), HALF, rtol=0.01)
    np.testing.assert_allclose(world.positions, before, atol=1e-3)
    assert world.num_ground_tunnellings == 0


def test_cubes_slide_down_a_slope_without_friction():
    world = cubes(slope=0.4, ground_friction=0.0, clamps=UNCLAMPED)
    world.add([[0, 0, HALF * np.hypot(1.0, 0.4)]], [[0, 0, 0]], LITRE)
    run(world, 1.0)
    # Half of the horizontal acceleration g sin(a) cos(a).
    assert world.positions[0, 0] == pytest.approx(-0.5 * GRAVITY * 0.4 / 1.16, rel=0.03)


def test_stacked_cubes_rest_on_one_another():
    world = cubes(clamps=UNCLAMPED)
    world.add([[0, 0, HALF + k * EDGE] for k in range(4)], np.zeros((4, 3)), LITRE)
    run(world, 0.5)
    np.testing.assert_allclose(world.positions[:, 2] / HALF, [1, 3, 5, 7], atol=0.05)


def test_cubes_follow_ground_that_changes():
    world = cubes()
    world.add([[0, 0, HALF], [3, 0, HALF]], np.zeros((2, 3)), LITRE)
    grid = world.ground.grid
    rows, cols = (index.ravel() for index in np.indices(grid.shape))
    heights = np.where(grid.x(rows) < 1.5, 0.3, -0.4)
    world.ground.set_heights(rows, cols, heights)
    for _ in range(300):
        world.ground.advance(STEP)
        world.step(STEP)
    np.testing.assert_allclose(world.positions[:, 2], [0.3 + HALF, -0.4 + HALF], atol=0.003)
    assert world.num_ground_tunnellings == 0


def test_cube_deep_in_the_ground_is_moved_to_the_surface():
    world = cubes()
    world.add([[0, 0, -0.5]], [[0, 0, 0]], LITRE)
    world.step(STEP)
    assert world.positions[0, 2] == pytest.approx(HALF)
    assert world.num_ground_tunnellings == 1


def test_cube_near_a_digging_tool_leaves_the_ground_at_limited_speed():
    world = cubes()
    world.add_tool(0, [square(0.2)], pose(z=0.4))
    world.add([[0.3, 0, 0]], [[0, 0, 0]], LITRE)
    world.ground.surface[:] = 0.15
    for _ in range(200):
        world.step(STEP)
        assert np.linalg.norm(world.velocities[0]) < 0.35
    assert world.positions[0, 2] == pytest.approx(0.15 + HALF, abs=0.002)
    assert world.num_ground_tunnellings == 0


def test_size_mass_and_friction_follow_from_the_soil():
    soils = [SOIL, LooseSoil(swell=0.5, density=2000.0, repose_angles=(30.0, 40.0, 45.0))]
    world = cubes(soils=soils)
    world.add(THREE, np.zeros((3, 3)), [LITRE, LITRE, 2 * LITRE], [0, 1, 1], [0, 50, 200])
    np.testing.assert_allclose(2.0 * world.radii, np.cbrt([1.25e-3, 1.5e-3, 3e-3]), rtol=1e-6)
    np.testing.assert_allclose(world.masses, [1.6, 2.0, 4.0], rtol=1e-6)
    np.testing.assert_allclose(
        world.contact_coefficients.friction, np.tan(np.radians([30.0, 40.0, 45.0])), rtol=1e-6
    )


def test_frozen_cube_supports_others_until_it_is_unfrozen():
    world = cubes()
    ids = world.add([[0, 0, 1.0], [0, 0, 1.0 + EDGE]], np.zeros((2, 3)), LITRE)
    world.freeze(ids[:1])
    run(world, 0.3)
    np.testing.assert_allclose(world.positions[:, 2], [1.0, 1.0 + EDGE], atol=0.002)
    world.unfreeze(ids[:1])
    run(world, 0.2)
    assert (world.positions[:, 2] < [0.85, 0.85 + EDGE]).all()


def test_tool_wrench_is_the_weight_of_a_resting_load():
    world = filled_box()
    force, torque = np.mean([_wrench(world) for _ in range(20)], axis=0)
    weight = GRAVITY * float(world.masses.sum())
    np.testing.assert_allclose(force, [0, 0, -weight], atol=0.1 * weight)
    arm = (world.masses[:, None] * world.positions_in_tool_frame(0)).sum(axis=0) * GRAVITY
    np.testing.assert_allclose(torque[:2], [-arm[1], arm[0]], atol=0.05 * weight)


def _wrench(world):
    world.step(STEP)
    return world.tool_wrench(0)


def test_cubes_stay_in_a_box_that_is_lifted_and_fall_out_when_it_is_tipped():
    world = filled_box()
    s = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 201))
    drive(world, [pose(k, 0.0, 1.0 + 0.7 * k) for k in s])
    assert fraction_inside(world) == 1.0
    drive(world, [pose(1.0, 0.0, 1.7, np.radians(150.0) * k) for k in s])
    run(world, 1.0)
    assert fraction_inside(world) == 0.0
    assert world.num_plate_tunnellings == 0
    assert world.num_ground_tunnellings == 0
    assert world.total_volume_mm3 == 40 * (LITRE // 2)


def test_friction_carries_a_cube_on_a_rotating_plate():
    world = cubes(clamps=UNCLAMPED)
    world.add_tool(0, [square(0.6)], pose(z=1.0))
    world.add([[0.3, 0, 1.01 + HALF]], [[0, 0, 0]], LITRE)
    run(world, 0.2)
    start = world.positions_in_tool_frame(0)[0]
    path = []
    for angle in 0.3 - 0.3 * np.cos(np.linspace(0.0, np.pi, 201)):
        c, s = np.cos(angle), np.sin(angle)
        path.append((np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([0, 0, 1.0])))
    drive(world, path)
    np.testing.assert_allclose(world.positions_in_tool_frame(0)[0], start, atol=0.01)


def test_tunnelling_through_a_plate_is_counted():
    world = cubes(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(z=2.0))
    world.add([[0, 0, 2.3], [0.7, 0, 2.3]], [[0, 0, -150.0]] * 2, LITRE)
    world.step(STEP)
    assert world.num_plate_tunnellings == 1


def test_load_falls_when_its_tool_is_removed():
    world = filled_box()
    heights = world.positions[:, 2].copy()
    world.remove_tool(0)
    run(world, 0.2)
    np.testing.assert_allclose(world.positions[:, 2], heights - 0.2, atol=0.02)
    with pytest.raises(ParticleError):
        world.tool_wrench(0)


def test_clamp_stops_upward_motion():
    heights = []
    for clamps in (None, UNCLAMPED):
        world = cubes(clamps=clamps)
        world.add([[0, 0, 1.0]], [[0, 0, 3.0]], LITRE)
        run(world, 0.3)
        heights.append(world.positions[0, 2])
    assert heights[0] == pytest.approx(1.0 - 0.5 * GRAVITY * 0.3**2, abs=0.02)
    assert heights[1] > 1.4


def test_clamp_damps_horizontal_velocity():
    world = cubes()
    world.add([[0, 0, 3.0]], [[2.0, 1.0, 0]], LITRE)
    run(world, 0.05)
    np.testing.assert_allclose(world.velocities[0, :2], np.array([2.0, 1.0]) / 1.1**10)


def test_clamps_keep_cubes_in_a_box_that_stops_abruptly():
    rises = []
    for clamps in (None, UNCLAMPED):
        world = filled_box(clamps=clamps)
        drive(world, [pose(z=1.0 + 0.0075 * k) for k in range(41)])
        top = world.positions_in_tool_frame(0)[:, 2].max()
        highest = top
        for _ in range(40):
            world.step(STEP)
            highest = max(highest, world.positions_in_tool_frame(0)[:, 2].max())
        rises.append(highest - top)
    assert rises[0] < 0.01
    assert rises[1] > 0.05


def test_cube_settles_after_the_settle_time_on_the_ground():
    world = cubes(settle_time=0.2)
    ids = world.add([[0, 0, HALF], [2, 0, 3.0]], np.zeros((2, 3)), LITRE)
    run(world, 0.15)
    assert world.settled().size == 0
    run(world, 0.1)
    np.testing.assert_array_equal(world.settled(), ids[:1])
    world.freeze(ids[:1])
    assert world.settled().size == 0


@pytest.mark.parametrize(("height", "settles"), [(0.84, True), (0.89, False)])
def test_cube_settles_only_within_half_a_diagonal_of_the_ground(height, settles):
    world = cubes()
    support = height - 0.5
    positions = [[0, 0, 0.5 * support * EDGE], [0, 0, height * EDGE]]
    ids = world.add(positions, np.zeros((2, 3)), [round(LITRE * support**3), LITRE])
    world.freeze(ids[:1])
    run(world, 0.2)
    assert world.settled().tolist() == ([int(ids[1])] if settles else [])


def test_cubes_settle_away_from_tools_or_off_the_map():
    world = cubes()
    world.add_tool(0, box(1.0, 1.0, 0.6), pose(z=0.0), is_digging=False)
    world.add_tool(1, [square(0.3)], pose(3.0, 0, 0.2, np.pi / 2))
    positions = [[0, 0, 0.07], [3.01 + HALF, 0, HALF], [3.5, 0, HALF], [8.2, 0, 2.0]]
    ids = world.add(positions, np.zeros((4, 3)), LITRE)
    run(world, 0.3)
    np.testing.assert_array_equal(world.settled(), ids[2:])


def test_run_is_reproducible_bit_for_bit():
    ends = []
    for _ in range(2):
        world = filled_box()
        world.remove([3, 17])
        world.freeze([5])
        drive(world, [pose(z=1.0, pitch=0.004 * k) for k in range(101)])
        world.add(THREE + np.array([0, 0, 1.0]), np.zeros((3, 3)), LITRE)
        run(world, 0.3)
        arrays = [world.positions, world.velocities, world.angular_velocities]
        ends.append([array.tobytes() for array in (*arrays, *world.tool_wrench(0))])
    assert ends[0] == ends[1]


def test_close_frees_the_pybullet_client_and_can_be_repeated():
    world = cubes()
    assert world.is_open
    world.close()
    assert not world.is_open
    world.close()

"""Soil as rigid cubes in pybullet: on the terrain, in tools, clamped, counted."""

import numpy as np
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import LITRE, STEP, box, cloud, pose, run, square

from machine_sim.dem import ParticleError, ParticleParams
from machine_sim.ground.contact_surface import Ground
from machine_sim.reference_cubes import CubeEngine, VelocityClamps
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(swell=0.25)
EDGE = np.cbrt(1.25e-3)
HALF = 0.5 * EDGE
FREE = VelocityClamps(enabled=False)
THREE = np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0.2, 1.0]])


def cubes(*, slope=0.0, soils=(SOIL,), clamps=None, **params):
    """An engine over a 16 m map whose height is `slope` * x."""
    grid = Grid(64, 64, 0.25)
    height = slope * grid.x(np.arange(64))[:, None] * np.ones((1, 64))
    given_params = ParticleParams.from_mapping(params)
    return CubeEngine(given_params, Ground(grid, height), soils=soils, clamps=clamps)


def filled_box(z=1.0, **options):
    """40 half-litre cubes at rest in a half-metre box that hangs in the air."""
    world = cubes(**options)
    world.add_tool(0, box(0.5, 0.5, 0.5), pose(z=z))
    points = cloud(40, 0.1, (0.35, 0.35), z + 0.05)
    world.add(points, np.zeros_like(points), LITRE // 2)
    run(world, 1.0)
    return world


def share_inside(world):
    x, y, z = world.positions_in_tool_frame(0).T
    return float(np.mean((np.abs(x) < 0.25) & (np.abs(y) < 0.25) & (z > 0.0) & (z < 0.6)))


def drive(world, path):
    """Move tool 0 along poses, one a step."""
    at = path[0]
    for to in path[1:]:
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to


# On the terrain.


@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_cubes_come_to_rest_on_the_ground(slope):
    world = cubes(slope=slope)
    points = np.array([[x, y, slope * x + 0.3] for x in (-2, 0, 1) for y in (-1, 0.1, 2)])
    world.add(points, np.zeros((9, 3)), LITRE)
    run(world, 1.0)
    before = world.state.position.copy()
    run(world, 0.5)
    x, _, z = world.state.position.T
    np.testing.assert_allclose((z - slope * x) / np.hypot(1.0, slope), HALF, rtol=0.01)
    np.testing.assert_allclose(world.state.position, before, atol=1e-3)
    assert world.num_ground_tunnellings == 0


def test_cubes_slide_down_a_slope_without_friction():
    world = cubes(slope=0.4, ground_friction=0.0, clamps=FREE)
    world.add([[0, 0, HALF * np.hypot(1.0, 0.4)]], [[0, 0, 0]], LITRE)
    run(world, 1.0)
    # Half of g sin(a) cos(a), level.
    assert world.state.position[0, 0] == pytest.approx(-0.5 * 9.81 * 0.4 / 1.16, rel=0.03)


def test_a_pile_rests_on_its_lowest_layer():
    world = cubes(clamps=FREE)
    world.add([[0, 0, HALF + k * EDGE] for k in range(4)], np.zeros((4, 3)), LITRE)
    run(world, 0.5)
    np.testing.assert_allclose(world.state.position[:, 2] / HALF, [1, 3, 5, 7], atol=0.05)


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
    np.testing.assert_allclose(world.state.position[:, 2], [0.3 + HALF, -0.4 + HALF], atol=0.003)
    assert world.num_ground_tunnellings == 0


def test_a_cube_deep_in_the_ground_is_put_upon_it():
    world = cubes()
    world.add([[0, 0, -0.5]], [[0, 0, 0]], LITRE)
    world.step(STEP)
    assert world.state.position[0, 2] == pytest.approx(HALF)
    assert world.num_ground_tunnellings == 1


def test_beside_a_digging_tool_it_comes_out_bit_by_bit():
    world = cubes()
    world.add_tool(0, [square(0.2)], pose(z=0.4))
    world.add([[0.3, 0, 0]], [[0, 0, 0]], LITRE)
    world.ground.surface[:] = 0.15
    for _ in range(200):
        world.step(STEP)
        assert np.linalg.norm(world.state.velocity[0]) < 0.35
    assert world.state.position[0, 2] == pytest.approx(0.15 + HALF, abs=0.002)
    assert world.num_ground_tunnellings == 0


# The account.

actions = st.lists(
    st.tuples(
        st.sampled_from(["add", "remove", "freeze", "unfreeze", "step"]),
        st.integers(0, 2**31),
    ),
    max_size=15,
)


@settings(max_examples=15, deadline=None)
@given(actions)
def test_volume_is_exact_under_any_work(work):
    world = cubes(soils=[LooseSoil()] * 3)
    book = {}
    for action, seed in work:
        rng = np.random.default_rng(seed)
        some = rng.permutation(list(book))[: rng.integers(0, 6)].astype(np.uint32)
        if action == "add":
            n = int(rng.integers(0, 12))
            volumes = rng.integers(1, 3 * LITRE, n)
            at = rng.uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 0.9], (n, 3))
            ids = world.add(at, np.zeros((n, 3)), volumes, 2, 9)
            book.update(zip(ids.tolist(), volumes.tolist(), strict=True))
        elif action == "step":
            world.step(STEP)
        else:
            getattr(world, action)(some)
            if action == "remove":
                for gone in some.tolist():
                    del book[gone]
        assert world.total_volume_mm3 == sum(book.values())
        ids, volumes = world.state.particle_id.tolist(), world.state.volume_mm3.tolist()
        assert dict(zip(ids, volumes, strict=True)) == book
        assert np.isfinite(world.state.position).all()


def test_size_mass_and_friction_are_the_soils():
    soils = [SOIL, LooseSoil(swell=0.5, density=2000.0, repose_angles=(30.0, 40.0, 45.0))]
    world = cubes(soils=soils)
    world.add(THREE, np.zeros((3, 3)), [LITRE, LITRE, 2 * LITRE], [0, 1, 1], [0, 50, 200])
    state = world.state
    np.testing.assert_allclose(2.0 * state.radius, np.cbrt([1.25e-3, 1.5e-3, 3e-3]), rtol=1e-6)
    np.testing.assert_allclose(state.mass, [1.6, 2.0, 4.0], rtol=1e-6)
    np.testing.assert_allclose(state.friction, np.tan(np.radians([30.0, 40.0, 45.0])), rtol=1e-6)


@pytest.mark.parametrize(
    ("position", "volume", "soil"),
    [
        ([[0, 0, np.nan]], LITRE, 0),
        ([[0, 0, 1]], 0, 0),
        ([[0, 0, 1]], 0.5, 0),
        ([[0, 0, 1]], 2**33, 0),
        ([[0, 0, 1]], [LITRE, LITRE], 0),
        ([[0, 0]], LITRE, 0),
        ([[0, 0, 1]], LITRE, 1),
        ([[0, 0, 1]], LITRE, 256),
        (THREE, LITRE, 0),
    ],
)
def test_bad_soil_is_refused_and_nothing_is_added(position, volume, soil):
    world = cubes(capacity=2)
    with pytest.raises(ParticleError):
        world.add(position, np.zeros_like(position, dtype=float), volume, soil)
    assert world.count == 0
    world.step(STEP)


@pytest.mark.parametrize("method", ["remove", "freeze", "unfreeze"])
def test_ids_that_are_not_alive_are_refused_and_change_nothing(method):
    world = cubes()
    world.add(THREE, np.zeros((3, 3)), LITRE)
    for ids in ([1, 99], [1, 1]):
        with pytest.raises(ParticleError):
            getattr(world, method)(ids)
    assert world.count == 3
    assert not world.state.frozen.any()


def test_a_frozen_cube_holds_others_until_it_is_let_go():
    world = cubes()
    ids = world.add([[0, 0, 1.0], [0, 0, 1.0 + EDGE]], np.zeros((2, 3)), LITRE)
    world.freeze(ids[:1])
    run(world, 0.3)
    np.testing.assert_allclose(world.state.position[:, 2], [1.0, 1.0 + EDGE], atol=0.002)
    world.unfreeze(ids[:1])
    run(world, 0.2)
    assert (world.state.position[:, 2] < [0.85, 0.85 + EDGE]).all()


# In tools.


def test_a_resting_load_weighs_on_the_tool():
    world = filled_box()
    force, torque = np.mean([_wrench(world) for _ in range(20)], axis=0)
    weight = 9.81 * float(world.state.mass.sum())
    np.testing.assert_allclose(force, [0, 0, -weight], atol=0.1 * weight)
    arm = (world.state.mass[:, None] * world.positions_in_tool_frame(0)).sum(axis=0) * 9.81
    np.testing.assert_allclose(torque[:2], [-arm[1], arm[0]], atol=0.05 * weight)


def _wrench(world):
    world.step(STEP)
    return world.tool_wrench(0)


def test_cubes_stay_in_a_box_that_is_lifted_and_fall_out_when_it_is_tipped():
    world = filled_box()
    s = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 201))
    drive(world, [pose(k, 0.0, 1.0 + 0.7 * k) for k in s])
    assert share_inside(world) == 1.0
    drive(world, [pose(1.0, 0.0, 1.7, np.radians(150.0) * k) for k in s])
    run(world, 1.0)
    assert share_inside(world) == 0.0
    assert world.num_plate_tunnellings == 0
    assert world.num_ground_tunnellings == 0
    assert world.total_volume_mm3 == 40 * (LITRE // 2)


def test_friction_takes_a_cube_along_on_a_turning_plate():
    world = cubes(clamps=FREE)
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


def test_a_cube_shot_through_a_plate_is_counted():
    world = cubes(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(z=2.0))
    world.add([[0, 0, 2.3], [0.7, 0, 2.3]], [[0, 0, -150.0]] * 2, LITRE)
    world.step(STEP)
    assert world.num_plate_tunnellings == 1


def test_what_lay_in_a_tool_that_is_taken_away_falls():
    world = filled_box()
    heights = world.state.position[:, 2].copy()
    world.remove_tool(0)
    run(world, 0.2)
    np.testing.assert_allclose(world.state.position[:, 2], heights - 0.2, atol=0.02)
    with pytest.raises(ParticleError):
        world.tool_wrench(0)


# Clamped.


def test_a_cube_thrown_up_falls():
    heights = []
    for clamps in (None, FREE):
        world = cubes(clamps=clamps)
        world.add([[0, 0, 1.0]], [[0, 0, 3.0]], LITRE)
        run(world, 0.3)
        heights.append(world.state.position[0, 2])
    assert heights[0] == pytest.approx(1.0 - 0.5 * 9.81 * 0.3**2, abs=0.02)
    assert heights[1] > 1.4


def test_a_falling_cube_loses_its_level_velocity():
    world = cubes()
    world.add([[0, 0, 3.0]], [[2.0, 1.0, 0]], LITRE)
    run(world, 0.05)
    np.testing.assert_allclose(world.state.velocity[0, :2], np.array([2.0, 1.0]) / 1.1**10)


def test_cubes_stay_down_in_a_box_whose_lift_stops_at_once():
    rises = []
    for clamps in (None, FREE):
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


# Landing.


def test_a_cube_lands_when_it_was_slow_on_the_ground_for_the_settle_time():
    world = cubes(settle_time=0.2)
    ids = world.add([[0, 0, HALF], [2, 0, 3.0]], np.zeros((2, 3)), LITRE)
    run(world, 0.15)
    assert world.settled().size == 0
    run(world, 0.1)
    np.testing.assert_array_equal(world.settled(), ids[:1])
    world.freeze(ids[:1])
    assert world.settled().size == 0


@pytest.mark.parametrize(("height", "lands"), [(0.84, True), (0.89, False)])
def test_the_ground_is_half_a_diagonal_away_at_most(height, lands):
    world = cubes()
    support = height - 0.5
    at = [[0, 0, 0.5 * support * EDGE], [0, 0, height * EDGE]]
    ids = world.add(at, np.zeros((2, 3)), [round(LITRE * support**3), LITRE])
    world.freeze(ids[:1])
    run(world, 0.2)
    assert world.settled().tolist() == ([int(ids[1])] if lands else [])


def test_cubes_at_or_in_a_tool_do_not_land_and_those_off_the_map_do():
    world = cubes()
    world.add_tool(0, box(1.0, 1.0, 0.6), pose(z=0.0), is_digging=False)
    world.add_tool(1, [square(0.3)], pose(3.0, 0, 0.2, np.pi / 2))
    places = [[0, 0, 0.07], [3.01 + HALF, 0, HALF], [3.5, 0, HALF], [8.2, 0, 2.0]]
    ids = world.add(places, np.zeros((4, 3)), LITRE)
    run(world, 0.3)
    np.testing.assert_array_equal(world.settled(), ids[2:])


# All of it.


def test_the_same_calls_give_the_same_bits():
    ends = []
    for _ in range(2):
        world = filled_box()
        world.remove([3, 17])
        world.freeze([5])
        drive(world, [pose(z=1.0, pitch=0.004 * k) for k in range(101)])
        world.add(THREE + np.array([0, 0, 1.0]), np.zeros((3, 3)), LITRE)
        run(world, 0.3)
        state = world.state
        ends.append(
            [state.position.tobytes(), state.velocity.tobytes(), state.angular_velocity.tobytes()]
        )
        ends[-1] += [part.tobytes() for part in world.tool_wrench(0)]
    assert ends[0] == ends[1]


def test_a_closed_engine_frees_its_client():
    world = cubes()
    client = world._client
    assert pybullet.isConnected(client)
    world.close()
    assert not pybullet.isConnected(client)
    world.close()

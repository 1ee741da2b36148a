"""One or two particles: rest, slide, rebound, momentum."""

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, engine, pose, run, square

from machine_sim.dem import ParticleError
from msg_bridge.contract.loose_soil import LooseSoil


def test_a_dropped_particle_rests_at_its_radius():
    world = engine()
    world.add([[0.03, 0.02, 0.4]], [[0.0, 0.0, 0.0]], LITRE, grow=False)
    run(world, 3.0)
    assert world.state.position[0, 2] == pytest.approx(world.state.radius[0], rel=0.01)
    assert np.abs(world.state.velocity).max() < 1e-5


def test_a_particle_is_as_large_and_heavy_as_its_loose_soil_says():
    world = engine(soils=[LooseSoil(0.3)])
    world.add([[0, 0, 1]], [[0, 0, 0]], LITRE)
    sphere = 4.0 / 3.0 * np.pi * world.state.radius[0] ** 3
    assert sphere == pytest.approx(1e-3 * 1.3 * 0.6, rel=1e-5)
    assert world.state.mass[0] == pytest.approx(1.6, rel=1e-6)


def test_particles_swell_and_weigh_as_their_own_soil_does():
    world = engine(soils=[LooseSoil(0.1, 1500.0), LooseSoil(0.65, 2400.0)])
    world.add([[0, 0, 1], [0, 0, 2]], np.zeros((2, 3)), LITRE, soil=[0, 1])
    spheres = 4.0 / 3.0 * np.pi * world.state.radius.astype(np.float64) ** 3
    assert spheres == pytest.approx([1.1e-3 * 0.6, 1.65e-3 * 0.6], rel=1e-5)
    assert world.state.mass == pytest.approx([1.5, 2.4], rel=1e-6)
    with pytest.raises(ParticleError, match="soil 2 is not known, only 2"):
        world.add([[0, 0, 1]], [[0, 0, 0]], LITRE, soil=2)
    assert world.state.count == 2


def test_an_engine_without_soils_is_refused():
    with pytest.raises(ParticleError, match="give one at least"):
        engine(soils=[])


def test_below_the_friction_angle_a_particle_stays():
    world = engine(slope=np.tan(np.radians(20)), ground_friction=0.6)
    start = _on_slope(world, 20.0)
    run(world, 2.0)
    assert np.linalg.norm(world.state.position[0] - start) < 0.01
    assert np.linalg.norm(world.state.velocity[0]) < 1e-4


def test_above_the_rolling_resistance_it_rolls_with_a_solid_sphere_s_inertia():
    angle, rolling = 30.0, 0.2
    world = engine(
        slope=np.tan(np.radians(angle)), ground_friction=1.0, ground_rolling_friction=rolling
    )
    _on_slope(world, angle)
    run(world, 0.3)
    early = np.linalg.norm(world.state.velocity[0])
    run(world, 0.5)
    gained = np.linalg.norm(world.state.velocity[0]) - early
    # m a = m g sin - F, 0.4 m r^2 (a / r) = F r - rolling * r * m g cos
    cosine = np.cos(np.radians(angle))
    expected = 9.81 * (np.sin(np.radians(angle)) - rolling * cosine) / 1.4
    assert gained / 0.5 == pytest.approx(expected, rel=0.01)
    angular_velocity = np.linalg.norm(world.state.angular_velocity[0]) * float(
        world.state.radius[0]
    )
    assert angular_velocity == pytest.approx(np.linalg.norm(world.state.velocity[0]), rel=0.01)


def test_above_the_friction_angle_it_slides_with_g_sin_minus_mu_cos():
    angle, friction = 30.0, 0.3
    world = engine(slope=np.tan(np.radians(angle)), ground_friction=friction)
    _on_slope(world, angle)
    run(world, 0.3)
    early = np.linalg.norm(world.state.velocity[0])
    run(world, 0.5)
    gained = np.linalg.norm(world.state.velocity[0]) - early
    expected = 9.81 * (np.sin(np.radians(angle)) - friction * np.cos(np.radians(angle)))
    assert gained / 0.5 == pytest.approx(expected, rel=0.01)


def _on_slope(world, angle):
    world.add([[0, 0, 1]], [[0, 0, 0]], LITRE, grow=False)
    radius = float(world.state.radius[0])
    world.state.position[0] = [0.0, 0.0, radius / np.cos(np.radians(angle))]
    return world.state.position[0].copy()


@pytest.mark.parametrize("restitution", [0.3, 0.5])
def test_a_head_on_collision_keeps_the_restitution(restitution):
    world = engine(gravity=0.0, restitution=restitution)
    # A collision lasts 7 substeps: where in a substep it begins matters a little, so average.
    for k in range(8):
        x, y = 0.1 + k * 0.5 * STEP / 5 / 8, 0.5 * k
        velocity = [[0.5, 0, 0], [-0.5, 0, 0]]
        world.add([[-x, y, 3], [x, y, 3]], velocity, LITRE, grow=False)
    run(world, 0.3)
    velocity = world.state.velocity[np.argsort(world.state.particle_id), 0]
    assert np.mean(velocity[1::2] - velocity[::2]) == pytest.approx(restitution, abs=0.04)


def test_an_oblique_collision_of_unequal_particles_keeps_momentum():
    world = engine(gravity=0.0)
    world.add(
        [[-0.1, 0.01, 3], [0.1, -0.02, 3.02]],
        [[1.0, 0.2, 0], [-1.0, 0, 0.1]],
        [LITRE, LITRE // 3],
        grow=False,
    )
    before = (world.state.mass[:, None] * world.state.velocity).sum(axis=0)
    v0 = world.state.velocity.copy()
    run(world, 0.3)
    after = (world.state.mass[:, None] * world.state.velocity).sum(axis=0)
    assert np.abs(world.state.velocity - v0).max() > 0.3, "they did collide"
    np.testing.assert_allclose(after, before, atol=1e-5)


def test_a_fast_particle_does_not_pass_through_another():
    world = engine(gravity=0.0)
    world.add([[-0.5, 0, 3], [0.0, 0, 3]], [[10.0, 0, 0], [0, 0, 0]], LITRE, grow=False)
    run(world, 0.1)
    assert world.state.velocity[1, 0] > 5.0
    assert world.state.position[1, 0] > world.state.position[0, 0]


def test_a_cliff_does_not_fire_off_a_particle_at_its_foot():
    world = engine()
    world.ground.set_heights(
        *np.nonzero(np.ones((64, 64))),
        np.where(world.ground.grid.x(np.arange(64)) > 0.3, 2.0, 0.0).repeat(64),
    )
    for _ in range(2000):
        world.ground.advance(STEP)
    world.add([[-0.5, 0, 0.06]], [[1.5, 0.1, 0]], LITRE, grow=False)
    fastest = 0.0
    for _ in range(300):
        world.step(STEP)
        fastest = max(fastest, float(np.linalg.norm(world.state.velocity[0])))
    assert fastest < 1.6
    assert world.num_ground_tunnellings == 0


def test_a_particle_deep_in_the_ground_is_put_back_upon_it_once():
    world = engine()
    world.add([[0, 0, -0.4]], [[0, 0, -1]], LITRE, grow=False)
    world.step(STEP)
    assert world.num_ground_tunnellings == 1
    run(world, 0.5)
    assert world.num_ground_tunnellings == 1
    assert world.state.position[0, 2] == pytest.approx(world.state.radius[0], rel=0.02)


@pytest.mark.parametrize("depth", [0.02, 0.1, 0.3])
def test_a_particle_under_ground_comes_out_gently_after_the_tool_has_left_it(depth):
    world = engine()
    world.add_tool(0, [square(0.4)], pose(0.0, 0.0, 0.5))
    world.add([[0, 0, -depth]], [[0, 0, 0]], LITRE, grow=False)
    world.step(STEP)
    world.set_tool_motion(0, pose(5.0, 0.0, 0.5), pose(5.0, 0.0, 0.5))
    fastest = 0.0
    for _ in range(400):
        world.step(STEP)
        fastest = max(fastest, float(np.linalg.norm(world.state.velocity[0])))
    assert fastest < 0.5
    assert world.num_ground_tunnellings == 0
    assert world.state.position[0, 2] == pytest.approx(world.state.radius[0], rel=0.02)


def test_once_out_of_the_ground_it_is_soft_no_more():
    world = engine(boundary_restitution=0.4, allow_sleeping=False)
    world.add_tool(0, [square(0.4)], pose(0.0, 0.0, 0.5))
    world.add([[0, 0, -0.02]], [[0, 0, 0]], LITRE, grow=False)
    world.step(STEP)
    world.set_tool_motion(0, pose(5.0, 0.0, 0.5), pose(5.0, 0.0, 0.5))
    run(world, 1.0)
    world.state.position[0, 2], world.state.velocity[0, 2] = 0.3, -3.0
    rebound = 0.0
    for _ in range(100):
        world.step(STEP)
        rebound = max(rebound, float(world.state.velocity[0, 2]))
    # Of 3.5 m/s the full push gives back the restitution's share, the soft one next to nothing.
    assert rebound > 0.9

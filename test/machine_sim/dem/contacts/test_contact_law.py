"""Contacts of one or two particles: rest, sliding, rolling, rebound, momentum."""

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, engine, pose, run, square

from machine_sim.dem import ParticleError
from msg_bridge.contract.loose_soil import LooseSoil


def test_dropped_particle_rests_at_its_radius():
    world = engine()
    world.add([[0.03, 0.02, 0.4]], [[0.0, 0.0, 0.0]], LITRE, grow=False)
    run(world, 3.0)
    assert world.state.position[0, 2] == pytest.approx(world.state.radius[0], rel=0.01)
    assert np.abs(world.state.velocity).max() < 1e-5


def test_particle_has_volume_and_mass_of_loose_soil():
    world = engine(soils=[LooseSoil(0.3)])
    world.add([[0, 0, 1]], [[0, 0, 0]], LITRE)
    sphere = 4.0 / 3.0 * np.pi * world.state.radius[0] ** 3
    assert sphere == pytest.approx(1e-3 * 1.3 * 0.6, rel=1e-5)
    assert world.state.mass[0] == pytest.approx(1.6, rel=1e-6)


def test_particles_have_swell_and_density_of_their_soil():
    world = engine(soils=[LooseSoil(0.1, 1500.0), LooseSoil(0.65, 2400.0)])
    world.add([[0, 0, 1], [0, 0, 2]], np.zeros((2, 3)), LITRE, soil=[0, 1])
    spheres = 4.0 / 3.0 * np.pi * world.state.radius.astype(np.float64) ** 3
    assert spheres == pytest.approx([1.1e-3 * 0.6, 1.65e-3 * 0.6], rel=1e-5)
    assert world.state.mass == pytest.approx([1.5, 2.4], rel=1e-6)
    with pytest.raises(ParticleError, match="soil type 2 is unknown"):
        world.add([[0, 0, 1]], [[0, 0, 0]], LITRE, soil=2)
    assert world.state.count == 2


def test_engine_without_soils_is_an_error():
    with pytest.raises(ParticleError):
        engine(soils=[])


def test_particle_rests_below_the_friction_angle():
    world = engine(slope=np.tan(np.radians(20)), ground_friction=0.6)
    start = _on_slope(world, 20.0)
    run(world, 2.0)
    assert np.linalg.norm(world.state.position[0] - start) < 0.01
    assert np.linalg.norm(world.state.velocity[0]) < 1e-4


def test_particle_rolls_with_the_inertia_of_a_solid_sphere():
    angle, rolling = 30.0, 0.2
    world = engine(
        slope=np.tan(np.radians(angle)), ground_friction=1.0, ground_rolling_friction=rolling
    )
    _on_slope(world, angle)
    run(world, 0.3)
    early = np.linalg.norm(world.state.velocity[0])
    run(world, 0.5)
    gain = np.linalg.norm(world.state.velocity[0]) - early
    # m a = m g sin - F, 0.4 m r^2 (a / r) = F r - rolling * r * m g cos
    cosine = np.cos(np.radians(angle))
    expected = 9.81 * (np.sin(np.radians(angle)) - rolling * cosine) / 1.4
    assert gain / 0.5 == pytest.approx(expected, rel=0.01)
    angular_velocity = np.linalg.norm(world.state.angular_velocity[0]) * float(
        world.state.radius[0]
    )
    assert angular_velocity == pytest.approx(np.linalg.norm(world.state.velocity[0]), rel=0.01)


def test_particle_slides_with_g_sin_minus_mu_cos():
    angle, friction = 30.0, 0.3
    world = engine(slope=np.tan(np.radians(angle)), ground_friction=friction)
    _on_slope(world, angle)
    run(world, 0.3)
    early = np.linalg.norm(world.state.velocity[0])
    run(world, 0.5)
    gain = np.linalg.norm(world.state.velocity[0]) - early
    expected = 9.81 * (np.sin(np.radians(angle)) - friction * np.cos(np.radians(angle)))
    assert gain / 0.5 == pytest.approx(expected, rel=0.01)


def _on_slope(world, angle):
    world.add([[0, 0, 1]], [[0, 0, 0]], LITRE, grow=False)
    radius = float(world.state.radius[0])
    world.state.position[0] = [0.0, 0.0, radius / np.cos(np.radians(angle))]
    return world.state.position[0].copy()


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.7])
def test_head_on_collision_has_the_restitution(restitution):
    world = engine(gravity=0.0, restitution=restitution)
    # A collision lasts 7 substeps. The phase of its start matters a little: average over phases.
    for k in range(8):
        x, y = 0.1 + k * 0.5 * STEP / 5 / 8, 0.5 * k
        velocity = [[0.5, 0, 0], [-0.5, 0, 0]]
        world.add([[-x, y, 3], [x, y, 3]], velocity, LITRE, grow=False)
    run(world, 0.3)
    velocity = world.state.velocity[np.argsort(world.state.particle_id), 0]
    assert np.mean(velocity[1::2] - velocity[::2]) == pytest.approx(restitution, abs=0.04)


def test_oblique_collision_conserves_momentum():
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
    assert np.abs(world.state.velocity - v0).max() > 0.3, "no collision"
    np.testing.assert_allclose(after, before, atol=1e-5)


@pytest.mark.parametrize("on_plate", [True, False])
@pytest.mark.parametrize("speed", [0.2, 5.0])
def test_impact_on_plate_and_ground_has_the_boundary_restitution(on_plate, speed):
    world = engine(gravity=0.0, boundary_restitution=0.4)
    surface = 3.0 * on_plate
    if on_plate:
        world.add_tool(0, [square(4.0)], pose(0.0, 0.0, surface))
    for k in range(8):
        z = surface + 0.2 + k * speed * STEP / 4 / 8
        world.add([[0, 0.5 * k - 2.0, z]], [[0, 0, -speed]], LITRE, grow=False)
    run(world, 0.3 / speed + 0.05)
    assert np.mean(world.state.velocity[:, 2]) / speed == pytest.approx(0.4, abs=0.04)


def angular_momentum(world):
    """Return the angular momentum about (0, 0, 3) [kg m^2/s], with the spin, shape (3,)."""
    mass = world.state.mass[:, None].astype(float)
    orbital = mass * np.cross(world.state.position - [0.0, 0.0, 3.0], world.state.velocity)
    inertia = 0.4 * mass * world.state.radius[:, None].astype(float) ** 2
    return (orbital + inertia * world.state.angular_velocity).sum(axis=0)


def collide_off_centre(*, speed, volume, rolling_friction):
    """Collide two particles off-centre; return the angular momentum before and after."""
    world = engine(gravity=0.0)
    velocity = [[0.5 * speed, 0.0, 0.0], [-0.5 * speed, 0.0, 0.0]]
    world.add([[-0.1, -0.03, 3], [0.1, 0.03, 3]], velocity, [LITRE, volume], grow=False)
    world.state.rolling_friction[:] = rolling_friction
    before = angular_momentum(world)
    run(world, 0.4 / speed + 0.02)
    assert np.abs(world.state.angular_velocity).max() > 1.0, "no collision"
    return before, angular_momentum(world)


@pytest.mark.parametrize("speed", [1.0, 10.0])
@pytest.mark.parametrize("volume", [LITRE, LITRE // 3])
def test_friction_conserves_angular_momentum(speed, volume):
    before, after = collide_off_centre(speed=speed, volume=volume, rolling_friction=0.0)
    np.testing.assert_allclose(after, before, atol=2e-5 * np.linalg.norm(before))


def test_rolling_resistance_takes_no_more_angular_momentum_than_its_limit():
    rolling_friction, speed = 0.05, 2.0
    before, after = collide_off_centre(speed=speed, volume=LITRE, rolling_friction=rolling_friction)
    radius = (0.75 / np.pi * 1.25e-3 * 0.6) ** (1 / 3)
    # Impulse along the line of centres, with a restitution of at most 0.75 and half the mass.
    impulse = 0.5 * 1.6 * 1.75 * speed * np.sqrt(1.0 - (0.06 / (2.0 * radius)) ** 2)
    limit = 2.0 * rolling_friction * radius * impulse
    assert 0.5 * limit < np.linalg.norm(before) - np.linalg.norm(after) < limit


def test_fast_particle_does_not_pass_through_another():
    world = engine(gravity=0.0)
    world.add([[-0.5, 0, 3], [0.0, 0, 3]], [[10.0, 0, 0], [0, 0, 0]], LITRE, grow=False)
    run(world, 0.1)
    assert world.state.velocity[1, 0] > 5.0
    assert world.state.position[1, 0] > world.state.position[0, 0]


def test_cliff_does_not_eject_a_particle_at_its_foot():
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


def test_particle_deep_in_the_ground_is_put_back_once():
    world = engine()
    world.add([[0, 0, -0.4]], [[0, 0, -1]], LITRE, grow=False)
    world.step(STEP)
    assert world.num_ground_tunnellings == 1
    run(world, 0.5)
    assert world.num_ground_tunnellings == 1
    assert world.state.position[0, 2] == pytest.approx(world.state.radius[0], rel=0.02)


@pytest.mark.parametrize("depth", [0.02, 0.1, 0.3])
def test_particle_below_ground_comes_out_slowly_after_the_tool_has_left(depth):
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


def test_particle_out_of_the_ground_is_not_penetration_limited():
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
    # At 3.5 m/s the full spring force restores the restitution, a limited one next to nothing.
    assert rebound > 0.9


def test_slit_between_cliffs_does_not_accelerate_particles():
    world = engine()
    x = world.ground.grid.x(np.arange(64))
    world.ground.set_heights(
        *np.nonzero(np.ones((64, 64))), np.where(np.abs(x) > 0.3, 2.0, 0.0).repeat(64)
    )
    for _ in range(2000):
        world.ground.advance(STEP)
    at = np.random.default_rng(0).uniform((-0.2, -2.0, 0.06), (0.2, 2.0, 0.5), (40, 3))
    world.add(at, np.tile([2.0, 0.1, 0.0], (40, 1)), LITRE, grow=False)
    fastest = 0.0
    for _ in range(400):
        world.step(STEP)
        fastest = max(fastest, float(np.linalg.norm(world.state.velocity, axis=1).max()))
    assert fastest < 5.0, "2 m/s, and the free fall of 0.5 m"

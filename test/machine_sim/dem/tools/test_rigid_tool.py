"""Particles in and at tools: carried, tipped out, pushing back, never through."""

import numpy as np
import pytest
from support.particle_scenes import LEVEL, LITRE, STEP, box, cloud, engine, pose, run, square

from msg_bridge.contract.loose_soil import LooseSoil


def smooth(t, span):
    """0 to 1 with no jump of acceleration."""
    x = min(max(t / span, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


@pytest.fixture(scope="module")
def filled():
    """800 half-litre particles at rest in a 1 m box, then lifted and swung, then tipped."""
    world = engine()
    world.add_tool(4, box(1.0, 1.0, 1.0), pose(z=0.5))
    points = cloud(800, 0.092, (0.85, 0.85), 0.5)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 1.5)

    def inside():
        x, y, z = world.positions_in_tool_frame(4).T
        return float(np.mean((np.abs(x) < 0.5) & (np.abs(y) < 0.5) & (z > 0) & (z < 1.3)))

    shares = {"filled": inside()}
    # 1.5 m up and 2 m along within 2 s: up to 3 m/s^2.
    at = pose(z=0.5)
    for k in range(400):
        s = smooth((k + 1) * STEP, 2.0)
        to = pose(2.0 * s, 0.0, 0.5 + 1.5 * s, 0.2 * np.sin(np.pi * s) ** 2)
        world.set_tool_motion(4, at, to)
        world.step(STEP)
        at = to
    shares["carried"] = inside()
    for k in range(600):
        to = pose(2.0, 0.0, 2.0, np.radians(120.0) * smooth((k + 1) * STEP, 3.0))
        world.set_tool_motion(4, at, to)
        world.step(STEP)
        at = to
    run(world, 1.5)
    shares["tipped"] = inside()
    return world, shares


def test_a_box_carries_its_soil(filled):
    _, shares = filled
    assert shares["filled"] == 1.0
    assert shares["carried"] >= 0.99


def test_a_tipped_box_empties(filled):
    assert filled[1]["tipped"] < 0.02


def test_nothing_goes_through_the_box(filled):
    world, _ = filled
    assert world.num_plate_tunnellings == 0
    assert world.num_ground_tunnellings == 0
    assert world.total_volume_mm3 == 800 * (LITRE // 2)


def test_a_resting_load_weighs_on_the_tool():
    world = engine()
    world.add_tool(0, box(0.4, 0.4, 0.6), pose(1.0, 0.0, 1.0))
    points = cloud(60, 0.092, (0.3, 0.3), 1.0)
    points[:, 0] += 1.0
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 2.0)
    force, torque = world.tool_wrench(0)
    weight = 9.81 * float(world.state.mass.sum())
    assert force[2] == pytest.approx(-weight, rel=1e-3)
    arm = (world.state.mass[:, None] * world.positions_in_tool_frame(0)).sum(axis=0) * 9.81
    # Rolling resistance takes couples up: less than a tenth of a radius' worth.
    np.testing.assert_allclose(torque[:2], [-arm[1], arm[0]], atol=0.005 * weight)


def test_the_tool_gets_the_angular_momentum_of_particles_apart():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.6)], pose(0.0, 0.0, 3.0))
    points = np.array([[-0.4, 0.3, 3.1], [0.4, 0.2, 3.1], [0.1, -0.4, 3.1]])
    world.add(points, [[0.3, 0.0, -1.0], [0.0, 0.2, -2.0], [-0.4, 0.1, -1.5]], LITRE, grow=False)

    def momentum():
        arm = world.state.position - [0.0, 0.0, 3.0]
        inertia = 0.4 * world.state.mass * world.state.radius**2
        orbit = np.cross(arm, world.state.mass[:, None] * world.state.velocity)
        return (orbit + inertia[:, None] * world.state.angular_velocity).sum(axis=0)

    world.state.tool_rolling_friction[:] = 0.0  # rolling resistance takes from the spin alone
    start, turned = momentum(), np.zeros(3)
    for _ in range(60):
        world.step(STEP)
        turned += world.tool_wrench(0)[1] * STEP
    assert np.linalg.norm(momentum() - start) > 0.5
    np.testing.assert_allclose(momentum() - start, -turned, atol=1e-4)


def test_the_tool_gets_what_the_particles_lose():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.4)], pose(0.0, 0.0, 3.0))
    points = cloud(80, 0.1, (0.5, 0.5), 3.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    impulse, at = np.zeros(3), pose(0.0, 0.0, 3.0)
    for k in range(60):
        to = pose(0.002 * k, 0.0, 3.0 + 0.005 * (k + 1), 0.002 * k)
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        impulse += world.tool_wrench(0)[0] * STEP
        at = to
    momentum = (world.state.mass[:, None] * world.state.velocity).sum(axis=0)
    assert np.linalg.norm(momentum) > 10.0
    np.testing.assert_allclose(-impulse, momentum, rtol=1e-3, atol=1e-3 * momentum.max())


# Radii of 45, 21, 12 and 4.5 mm. Of 12 mm at 11 m/s, or 4.5 mm at 3 m/s, some go through: a plate
# that goes three radii or more in a step is too fast for them.
@pytest.mark.parametrize(
    ("speed", "volume"),
    [
        (1.0, LITRE // 2),
        (1.0, LITRE // 100),
        (1.0, LITRE // 2000),
        (3.0, LITRE // 2),
        (3.0, LITRE // 100),
        (11.0, LITRE // 2),
        (11.0, LITRE // 20),
    ],
)
def test_no_particle_goes_through_a_fast_plate(speed, volume):
    world = engine()
    size = float(np.cbrt(volume / LITRE))
    at = pose(-0.7, 0.0, 0.5, np.pi / 2)
    world.add_tool(0, [square(0.5)], at)
    points = cloud(300, 0.125 * size, (0.6, 0.6), 0.01)
    world.add(points, np.zeros_like(points), volume, grow=False)
    run(world, 0.3)
    hardest = 0.0
    for k in range(min(100, round(2.0 / (speed * STEP)))):
        x = -0.7 + speed * STEP * (k + 1)
        to = pose(x, 0.0, 0.5, np.pi / 2)
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        hardest = max(hardest, -float(world.tool_wrench(0)[0][0]))
        at = to
    assert hardest > 9.81 * float(world.state.mass[0]), "the plate met them"
    assert world.num_plate_tunnellings == 0


@pytest.mark.parametrize("volume", [LITRE // 5, LITRE // 20])
def test_a_fast_plate_does_not_step_over_sleepers(volume):
    world = engine()
    at = pose(-1.2, 0.0, 0.5, np.pi / 2)
    world.add_tool(0, [square(0.5)], at)
    points = cloud(200, 0.125 * np.cbrt(volume / LITRE), (0.4, 0.4), 0.01)
    world.add(points, np.zeros_like(points), volume, grow=False)
    run(world, 2.5)
    assert world.state.sleep_state.mean() > 0.9
    for k in range(25):
        to = pose(-1.2 + 11.0 * STEP * (k + 1), 0.0, 0.5, np.pi / 2)
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to
    assert world.num_plate_tunnellings == 0


def test_a_particle_put_beyond_a_plate_is_counted():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(0, 0, 2.0))
    world.add([[0, 0, 2.3]], [[0, 0, -150.0]], LITRE, grow=False)
    world.step(STEP)
    assert world.state.position[0, 2] < 2.0
    assert world.num_plate_tunnellings == 1


def test_a_fall_past_the_edge_of_a_plate_is_not_counted():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(0, 0, 2.0))
    world.add([[0.7, 0, 2.3]], [[0, 0, -5.0]], LITRE, grow=False)
    run(world, 0.1)
    assert world.state.position[0, 2] < 2.0
    assert world.num_plate_tunnellings == 0


def test_friction_carries_a_particle_on_a_turning_plate():
    world = engine()
    world.add_tool(0, [square(0.6)], pose(0, 0, 1.0))
    world.add([[0.3, 0, 1.06]], [[0, 0, 0]], LITRE, grow=False)
    run(world, 0.5)
    start = world.positions_in_tool_frame(0)[0]
    at = (LEVEL, np.array([0, 0, 1.0]))
    for k in range(200):
        angle = 0.6 * smooth((k + 1) * STEP, 1.0)
        c, s = np.cos(angle), np.sin(angle)
        to = (np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([0, 0, 1.0]))
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to
    assert np.linalg.norm(world.positions_in_tool_frame(0)[0] - start) < 0.01


@pytest.mark.parametrize(("adhesion", "stays"), [(0.0, False), (150e3, True)])
def test_sticky_soil_stays_on_a_steep_plate(adhesion, stays):
    world = engine(soils=[LooseSoil(adhesion=adhesion)])
    steep = pose(0.0, 0.0, 3.0, np.radians(60.0))
    world.add_tool(0, [square(1.0)], steep)
    radius = 0.0521
    away = steep[0] @ np.array([0.0, 0.0, radius])
    world.add([steep[1] + away], [[0, 0, 0]], LITRE, grow=False)
    world.state.tool_rolling_friction[:] = 2.0  # so that it slides or stays
    run(world, 0.5)
    went = np.linalg.norm(world.positions_in_tool_frame(0)[0] - [0.0, 0.0, radius])
    assert (went < 0.02) == stays


def test_cohesion_holds_two_particles_together():
    def apart(cohesion):
        world = engine(gravity=0.0, soils=[LooseSoil(cohesion=cohesion)])
        world.add([[0, 0, 3], [0.1046, 0, 3]], np.zeros((2, 3)), LITRE, grow=False)
        run(world, 0.2)
        world.state.velocity[:, 0] += [-0.02, 0.02]
        run(world, 1.0)
        return float(world.state.position[1, 0] - world.state.position[0, 0])

    assert abs(apart(20e3)) < 0.11
    assert abs(apart(0.0)) > 0.13

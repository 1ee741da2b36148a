"""Particles in and at tools: carried, tipped out, pushing back, no tunnelling."""

import numpy as np
import pytest
from support.particle_scenes import (
    LITRE,
    STEP,
    box,
    cloud,
    drive,
    drive_steps,
    engine,
    pose,
    run,
    square,
)

from machine_sim.dem.sleep import AWAKE
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.loose_soil import LooseSoil


def smooth(t, span):
    """Return a ramp from 0 to 1 within `span` without a jump of its second derivative."""
    x = min(max(t / span, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


@pytest.fixture(scope="module")
def filled():
    """800 half-litre particles at rest in a 1 m box, which is lifted, moved and tipped.

    Returns the engine and the fraction of the particles in the box after each stage.
    """
    world = engine()
    world.add_tool(4, box(1.0, 1.0, 1.0), pose(z=0.5))
    points = cloud(800, 0.092, (0.85, 0.85), 0.5)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 1.5)

    def fraction_inside():
        x, y, z = world.positions_in_tool_frame(4).T
        return float(np.mean((np.abs(x) < 0.5) & (np.abs(y) < 0.5) & (z > 0) & (z < 1.3)))

    fractions = {"filled": fraction_inside()}
    # 1.5 m up and 2 m along within 2 s: up to 3 m/s^2.
    path = [
        pose(2.0 * s, 0.0, 0.5 + 1.5 * s, 0.2 * np.sin(np.pi * s) ** 2)
        for s in (smooth(k * STEP, 2.0) for k in range(401))
    ]
    drive(world, path, 4)
    fractions["carried"] = fraction_inside()
    pitches = [np.radians(120.0) * smooth(k * STEP, 3.0) for k in range(601)]
    drive(world, (pose(2.0, 0.0, 2.0, pitch) for pitch in pitches), 4)
    run(world, 1.5)
    fractions["tipped"] = fraction_inside()
    return world, fractions


def test_box_carries_its_soil(filled):
    _, fractions = filled
    assert fractions["filled"] == 1.0
    assert fractions["carried"] >= 0.99


def test_tipped_box_empties(filled):
    assert filled[1]["tipped"] < 0.02


def test_no_particle_tunnels_through_the_box(filled):
    world, _ = filled
    assert world.num_plate_tunnellings == 0
    assert world.num_ground_tunnellings == 0
    assert world.total_volume_mm3 == 800 * (LITRE // 2)


def test_tool_wrench_is_the_weight_of_a_resting_load():
    world = engine()
    world.add_tool(0, box(0.4, 0.4, 0.6), pose(1.0, 0.0, 1.0))
    points = cloud(60, 0.092, (0.3, 0.3), 1.0)
    points[:, 0] += 1.0
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 2.0)
    force, torque = world.tool_wrench(0)
    weight = GRAVITY * float(world.masses.sum())
    assert force[2] == pytest.approx(-weight, rel=1e-3)
    arm = (world.masses[:, None] * world.positions_in_tool_frame(0)).sum(axis=0) * GRAVITY
    # Rolling resistance transmits couples: less than the weight times a tenth of a radius.
    np.testing.assert_allclose(torque[:2], [-arm[1], arm[0]], atol=0.005 * weight)


def test_torque_on_a_tool_is_the_angular_momentum_the_particles_lose():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.6)], pose(0.0, 0.0, 3.0))
    points = np.array([[-0.4, 0.3, 3.1], [0.4, 0.2, 3.1], [0.1, -0.4, 3.1]])
    world.add(points, [[0.3, 0.0, -1.0], [0.0, 0.2, -2.0], [-0.4, 0.1, -1.5]], LITRE, grow=False)

    def momentum():
        arm = world.positions - [0.0, 0.0, 3.0]
        inertia = 0.4 * world.masses * world.radii**2
        orbit = np.cross(arm, world.masses[:, None] * world.velocities)
        return (orbit + inertia[:, None] * world.angular_velocities).sum(axis=0)

    # Rolling resistance changes the angular velocity without a torque on the tool.
    world.state.tool_rolling_friction[:] = 0.0
    start, angular_impulse = momentum(), np.zeros(3)
    for _ in range(60):
        world.step(STEP)
        angular_impulse += world.tool_wrench(0)[1] * STEP
    assert np.linalg.norm(momentum() - start) > 0.5
    np.testing.assert_allclose(momentum() - start, -angular_impulse, atol=1e-4)


def test_impulse_on_a_tool_is_the_momentum_the_particles_gain():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.4)], pose(0.0, 0.0, 3.0))
    points = cloud(80, 0.1, (0.5, 0.5), 3.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    impulse = np.zeros(3)
    for _ in drive_steps(
        world, (pose(0.002 * k, 0.0, 3.0 + 0.005 * k, 0.002 * k) for k in range(61))
    ):
        impulse += world.tool_wrench(0)[0] * STEP
    momentum = (world.masses[:, None] * world.velocities).sum(axis=0)
    assert np.linalg.norm(momentum) > 10.0
    np.testing.assert_allclose(-impulse, momentum, rtol=1e-3, atol=1e-3 * momentum.max())


# Radii of 45, 21, 12 and 4.5 mm. At 11 m/s some particles of 12 mm tunnel, at 3 m/s some of 4.5 mm:
# a plate that moves three radii or more in a step is too fast for them.
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
def test_no_particle_tunnels_through_a_fast_plate(speed, volume):
    world = engine()
    size = float(np.cbrt(volume / LITRE))
    num_steps = min(100, round(2.0 / (speed * STEP)))
    path = [pose(-0.7 + speed * STEP * k, 0.0, 0.5, np.pi / 2) for k in range(num_steps + 1)]
    world.add_tool(0, [square(0.5)], path[0])
    points = cloud(300, 0.125 * size, (0.6, 0.6), 0.01)
    world.add(points, np.zeros_like(points), volume, grow=False)
    run(world, 0.3)
    max_push = 0.0
    for _ in drive_steps(world, path):
        max_push = max(max_push, -float(world.tool_wrench(0)[0][0]))
    assert max_push > GRAVITY * float(world.masses[0]), "the plate did not touch them"
    assert world.num_plate_tunnellings == 0


@pytest.mark.parametrize("volume", [LITRE // 5, LITRE // 20])
def test_fast_plate_wakes_sleeping_particles_in_time(volume):
    world = engine()
    path = [pose(-1.2 + 11.0 * STEP * k, 0.0, 0.5, np.pi / 2) for k in range(26)]
    world.add_tool(0, [square(0.5)], path[0])
    points = cloud(200, 0.125 * np.cbrt(volume / LITRE), (0.4, 0.4), 0.01)
    world.add(points, np.zeros_like(points), volume, grow=False)
    run(world, 2.5)
    assert (world.sleep_states != AWAKE).mean() > 0.9
    drive(world, path)
    assert world.num_plate_tunnellings == 0


def test_particle_does_not_pass_a_plate_at_any_speed():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(0, 0, 2.0))
    world.add([[0, 0, 2.3]], [[0, 0, -150.0]], LITRE, grow=False)
    world.step(STEP)
    assert world.positions[0, 2] > 2.0
    assert world.num_plate_tunnellings == 0


def test_particle_that_tunnels_through_a_plate_is_counted():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(0, 0, 2.0))
    heights = [pose(0.0, 0.0, 2.3 - 0.1 * k) for k in range(6)]
    world.add_tool(1, [square(0.5)], heights[0])
    world.add([[0, 0, 2.15]], [[0, 0, 0]], LITRE, grow=False)
    # A plate that passes another one takes the particle between them along.
    drive(world, heights, tool_id=1)
    assert world.positions[0, 2] < 2.0
    assert world.num_plate_tunnellings == 1


def test_fall_past_the_edge_of_a_plate_is_not_counted():
    world = engine(gravity=0.0)
    world.add_tool(0, [square(0.5)], pose(0, 0, 2.0))
    world.add([[0.7, 0, 2.3]], [[0, 0, -5.0]], LITRE, grow=False)
    run(world, 0.1)
    assert world.positions[0, 2] < 2.0
    assert world.num_plate_tunnellings == 0


def test_friction_carries_a_particle_on_a_turning_plate():
    world = engine()
    world.add_tool(0, [square(0.6)], pose(0, 0, 1.0))
    world.add([[0.3, 0, 1.06]], [[0, 0, 0]], LITRE, grow=False)
    run(world, 0.5)
    start = world.positions_in_tool_frame(0)[0]
    path = []
    for k in range(201):
        angle = 0.6 * smooth(k * STEP, 1.0)
        c, s = np.cos(angle), np.sin(angle)
        path.append((np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([0, 0, 1.0])))
    drive(world, path)
    assert np.linalg.norm(world.positions_in_tool_frame(0)[0] - start) < 0.01


@pytest.mark.parametrize(("adhesion", "sticks"), [(0.0, False), (150e3, True)])
def test_adhesion_holds_a_particle_on_a_steep_plate(adhesion, sticks):
    world = engine(soils=[LooseSoil(adhesion=adhesion)])
    rotation, origin = steep = pose(0.0, 0.0, 3.0, np.radians(60.0))
    world.add_tool(0, [square(1.0)], steep)
    local = np.array([0.0, 0.0, 0.0521])
    world.add([origin + rotation @ local], [[0, 0, 0]], LITRE, grow=False)
    world.state.tool_rolling_friction[:] = 2.0  # so that it slides or sticks, but does not roll
    run(world, 0.5)
    displacement = np.linalg.norm(world.positions_in_tool_frame(0)[0] - local)
    assert (displacement < 0.02) == sticks


def test_cohesion_holds_two_particles_together():
    def distance(cohesion):
        world = engine(gravity=0.0, soils=[LooseSoil(cohesion=cohesion)])
        world.add([[0, 0, 3], [0.1046, 0, 3]], np.zeros((2, 3)), LITRE, grow=False)
        run(world, 0.2)
        world.state.velocity[:, 0] += [-0.02, 0.02]
        run(world, 1.0)
        return float(world.positions[1, 0] - world.positions[0, 0])

    assert abs(distance(20e3)) < 0.11
    assert abs(distance(0.0)) > 0.13

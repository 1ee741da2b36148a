"""Kinematic tracks: driving, turning, stopping, holding on slopes and sliding."""

import math

import numpy as np
import pytest

from machine_sim.machine import MachineError
from machine_sim.machine.rotations import quaternion_from_matrix

from ..conftest import DT


def test_machine_drives_at_the_commanded_speed(scene):
    s = scene(position=(-8.0, 0.0))
    s.machine.command([0.0] * 4, [0.8, 0.8])
    s.run(1.0)
    start = s.position
    s.run(3.0)
    displacement = s.position - start
    assert displacement[0] / 3.0 == pytest.approx(0.8, rel=0.02)
    assert abs(displacement[1]) < 1e-3


def test_machine_reverses_at_the_commanded_speed(scene):
    s = scene(position=(8.0, 0.0))
    s.machine.command([0.0] * 4, [-0.8, -0.8])
    s.run(1.0)
    start = s.position
    s.run(2.0)
    assert (s.position - start)[0] / 2.0 == pytest.approx(-0.8, rel=0.02)


def test_opposed_tracks_pivot_on_the_spot(scene):
    s = scene()
    s.machine.command([0.0] * 4, [-0.5, 0.5])
    s.run(1.0)
    start = s.position
    positions = []
    for _ in range(12):
        s.run(1.0)
        positions.append(s.position)
    _, angular_velocity = s.machine.base_velocity
    assert 0.2 < angular_velocity[2] < 0.42  # slower than without slip: 2 * 0.5 / 2.38
    assert np.linalg.norm(np.array(positions) - start, axis=1).max() < 1.0
    assert s.machine.tilt < 0.02


def test_drives_supply_the_force_that_pulls_a_load(scene):
    s = scene(position=(-8.0, 0.0))
    s.machine.command([0.0] * 4, [0.5, 0.5])
    s.run(2.0)
    unloaded = s.machine.tracks.drive_forces.sum()
    s.run(2.0, pull=60e3)
    loaded = s.machine.tracks.drive_forces.copy()
    assert loaded.sum() - unloaded == pytest.approx(60e3, rel=0.05)
    assert loaded[0] == pytest.approx(loaded[1], rel=0.1)


def test_machine_stops_within_10_cm(scene):
    s = scene()
    s.run(1.0)
    s.machine.command([0.0] * 4, [0.8, 0.8])
    s.run(2.0)
    start = s.position
    s.machine.command([0.0] * 4, [0.0, 0.0])
    stopping = []
    for _ in range(200):
        s.step()
        stopping.append((s.position - start)[0])
    assert max(stopping) <= 0.10
    assert np.ptp(stopping[-40:]) < 3e-3
    np.testing.assert_array_equal(s.machine.tracks.speed, 0.0)


@pytest.mark.parametrize("slope", [15, 25])
@pytest.mark.parametrize("yaw", [0.0, 0.5 * math.pi])
def test_machine_holds_on_a_slope(scene, slope, yaw):
    s = scene(slope_deg=slope, yaw=yaw)
    s.run(2.0)
    start = s.position
    s.run(5.0)
    assert np.linalg.norm(s.position - start) < 0.002


def test_machine_holds_facing_downhill(scene):
    """The arm's weight is over the idlers, so the machine oscillates longer before it rests."""
    s = scene(slope_deg=25, yaw=math.pi)
    s.run(8.0)
    start = s.position
    s.run(5.0)
    assert np.linalg.norm(s.position - start) < 0.002


def test_machine_slides_on_a_slope_steeper_than_friction(scene):
    """mu = 0.8 holds to 38.7 degrees."""
    s = scene(slope_deg=41, yaw=0.0)
    s.run(2.0)
    assert s.position[0] < -0.3


def test_machine_beyond_a_sloped_edge_of_the_map_stands_still(scene):
    """The last cell falls at 45 degrees; mu = 0.8 would not hold there, but beyond it is level."""
    s = scene(lambda x, y: np.where(x < -12.75, -0.1, 0.0), position=(-11.0, 0.0))
    s.machine.command([0.0] * 4, [-1.2, -1.2])
    s.run(4.0)
    s.machine.command([0.0] * 4, [0.0, 0.0])
    s.run(2.0)
    start = s.position
    assert start[0] < -15.0
    s.run(1.0)
    assert np.linalg.norm(s.position - start) < 0.002


def test_shoes_carry_the_weight(scene, spec):
    s = scene()
    s.run(3.0)
    tracks = s.machine.tracks
    weight = spec.mass * 9.81
    assert tracks.shoe_loads.sum() == pytest.approx(weight, rel=1e-3)
    assert tracks.wrench[2] == pytest.approx(weight, rel=1e-3)
    assert (
        30 <= np.count_nonzero(tracks.shoe_loads) <= 36
    )  # 16.5 pitches on the ground on each side


def test_shoes_are_on_the_path_one_pitch_apart(scene, spec):
    s = scene()
    s.machine.command([0.0] * 4, [0.5, 0.3])
    s.run(1.0)
    shape = spec.tracks
    for side in range(2):
        x, z, pitch = s.machine.tracks.shoe_poses[side].T
        over = np.maximum(np.abs(x) - 0.5 * shape.axle_distance, 0.0)
        distance = np.hypot(over, z - shape.axle_height)
        np.testing.assert_allclose(distance, shape.sprocket_radius, atol=1e-9)
        gaps = np.hypot(np.diff(x), np.diff(z))
        assert gaps.max() <= shape.pitch + 1e-9
        assert gaps.min() > 0.95 * shape.pitch  # chords of the wheels
        # The outward normal of a shoe is its local z, which points away from the path.
        outward = np.column_stack([np.sin(pitch), np.cos(pitch)])
        radial = np.column_stack([np.sign(x) * over, z - shape.axle_height])
        np.testing.assert_allclose(outward * shape.sprocket_radius, radial, atol=1e-9)


@pytest.mark.parametrize(("height", "touches"), [(1.95, True), (1.975, False)])
def test_soles_on_the_idlers_touch_the_ground(scene, spec, height, touches):
    """Nose down, the lowest sole is half the axle distance, a radius and half a shoe ahead."""
    s = scene()
    nose_down = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    com = [0.0, 0.0, height] + nose_down @ spec.links["base"].center_of_mass
    orientation = quaternion_from_matrix(nose_down)
    s.client.resetBasePositionAndOrientation(s.machine.body, com.tolist(), orientation)
    s.machine.after_step()
    s.machine.before_step(DT)
    assert s.machine.tracks.shoe_loads.any() == touches  # 1.572 + 0.36 + 0.03 = 1.962 m


def test_left_track_is_first(scene):
    s = scene()
    s.machine.command([0.0] * 4, [0.0, 0.5])
    s.run(2.0)
    assert s.machine.base_velocity[1][2] > 0.1  # a faster right track turns left


def test_speed_command_is_limited_to_the_maximum(scene, spec):
    s = scene(position=(-8.0, 0.0))
    s.machine.command([0.0] * 4, [9.0, 9.0])
    s.run(2.0)
    assert s.machine.tracks.speed == pytest.approx(spec.tracks.max_speed, rel=0.03)


def test_initial_pose_follows_the_slope(scene):
    s = scene(slope_deg=20, yaw=0.7, position=(2.0, -3.0))
    assert s.machine.tilt == pytest.approx(math.radians(20))
    assert s.position[2] == pytest.approx(2.0 * math.tan(math.radians(20)), abs=0.03)
    forward = s.machine.base_pose[1]
    assert np.linalg.norm(forward) == pytest.approx(1.0)


@pytest.mark.parametrize("position", [(99.0, 0.0), (math.nan, 0.0), (0.0, 0.0, 0.0)])
def test_invalid_initial_position_is_rejected(scene, position):
    with pytest.raises(MachineError):
        scene(position=position)


def test_machine_follows_ground_that_is_lowered(scene):
    s = scene()
    s.run(1.0)
    before = s.position[2]
    s.lower_ground(0.1)
    s.run(2.0)
    assert s.position[2] - before == pytest.approx(-0.1, abs=2e-3)

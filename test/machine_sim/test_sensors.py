"""Sensors: readings of inertial units and encoders, their delay and errors."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.machine_scenes import excavator

from machine_sim.machine import rotation_matrix
from machine_sim.machine.forward_kinematics import link_poses
from machine_sim.machine.link_motion import link_motions
from machine_sim.sensors import SensorParams, Sensors

MACHINE = excavator()
STILL = (np.zeros(3), np.zeros(3))
STEP = 0.02


def motion(swing=0.0, rate=0.0, pose=None, velocity=STILL):
    """Return a machine state with a swing angle and rate."""
    joints = np.array([swing, -0.7, 1.85, 1.9])
    return SimpleNamespace(
        base_pose=pose or (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
        base_velocity=velocity,
        joint_positions=joints,
        joint_velocities=np.array([rate, 0.0, 0.0, 0.0]),
    )


def sensors(seed=0, **params):
    return Sensors(MACHINE, SensorParams(**params), seed)


def pitched(angle):
    return np.zeros(3), np.array([0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle)])


@pytest.mark.parametrize("pitch", [0.0, 0.3, -0.6])
def test_unit_at_rest_measures_gravity_in_its_own_axes(pitch):
    units = sensors()
    for k in range(3):
        readings, _ = units.read(motion(pose=pitched(pitch)), k * STEP)
        for reading in readings:
            expected = [-9.81 * math.sin(pitch), 0.0, 9.81 * math.cos(pitch)]
            np.testing.assert_allclose(reading.specific_force, expected, atol=1e-9)
            np.testing.assert_allclose(reading.angular_velocity, 0.0, atol=1e-12)
    assert [reading.name for reading in readings] == ["base", "upper"]


def test_unit_on_the_upper_body_measures_the_swing():
    units, rate = sensors(), 1.0
    for k in range(20):
        (base, upper), _ = units.read(motion(rate * k * STEP, rate), k * STEP)
    mount = next(imu for imu in MACHINE.imus if imu.name == "upper")
    np.testing.assert_allclose(upper.angular_velocity, [0.0, 0.0, rate], atol=1e-12)
    np.testing.assert_allclose(base.angular_velocity, 0.0, atol=1e-12)
    # Toward the axis; over a reading's time the direction turns a little.
    assert upper.specific_force[0] == pytest.approx(-(rate**2) * mount.position[0], rel=0.02)
    assert abs(upper.specific_force[1]) < 0.02
    assert upper.specific_force[2] == pytest.approx(9.81)


def test_braking_gives_a_backward_acceleration():
    units = sensors()
    for k in range(3):
        speed = np.array([1.0 - 2.0 * k * STEP, 0.0, 0.0])
        (base, _), _ = units.read(motion(velocity=(speed, np.zeros(3))), k * STEP)
    np.testing.assert_allclose(base.specific_force, [-2.0, 0.0, 9.81], atol=1e-9)


def test_link_velocities_are_the_derivatives_of_link_poses():
    rng, step = np.random.default_rng(3), 1e-6
    for _ in range(20):
        place, velocity, angular_velocity = rng.normal(size=(3, 3))
        turn, joints, rates = rng.normal(size=4), rng.uniform(-1.0, 1.0, 4), rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        motions = link_motions(MACHINE, place, turn, velocity, angular_velocity, joints, rates)

        def at(
            time,
            turn=turn,
            start=(place, joints),
            speed=(velocity, rates),
            angular_velocity=angular_velocity,
        ):
            angle = np.linalg.norm(angular_velocity) * time
            x, y, z = np.sin(0.5 * angle) * angular_velocity / np.linalg.norm(angular_velocity)
            w = np.cos(0.5 * angle)
            a, b, c, d = turn
            turned = [
                w * a + x * d + y * c - z * b,
                w * b - x * c + y * d + z * a,
                w * c + x * b - y * a + z * d,
                w * d - x * a - y * b - z * c,
            ]
            where, angles = (a + b * time for a, b in zip(start, speed, strict=True))
            return link_poses(MACHINE, where, turned, angles)

        before, after = at(-step), at(step)
        for k, name in enumerate(excavator().links):
            motion = motions[name]
            speed = (after.positions[k] - before.positions[k]) / (2.0 * step)
            np.testing.assert_allclose(motion.velocity, speed, atol=1e-6)
            turning = (
                rotation_matrix(after.quaternions[k]) - rotation_matrix(before.quaternions[k])
            ) / (2.0 * step)
            skew = turning @ motion.rotation.T
            found = [skew[2, 1], skew[0, 2], skew[1, 0]]
            np.testing.assert_allclose(motion.angular_velocity, found, atol=1e-6)
            point = rng.normal(size=3)
            expected = speed + np.cross(motion.angular_velocity, motion.rotation @ point)
            np.testing.assert_allclose(motion.velocity_at(point), expected, atol=1e-5)


def test_encoders_report_with_their_delay():
    units = sensors(encoder_delay=0.05)
    times = []
    for k in range(10):
        _, encoders = units.read(motion(swing=0.1 * k, rate=5.0), k * STEP)
        times.append(encoders.time)
        assert encoders.angles[0] == pytest.approx(0.1 * encoders.time / STEP)
        assert encoders.speeds[0] == 5.0
    # Nothing older than the first reading; then the newest that is 50 ms old or more.
    assert times == pytest.approx([0, 0, 0, 0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12])


def test_errors_have_the_given_deviations_and_are_reproducible():
    asked = {
        "accelerometer_noise": 0.05,
        "gyro_noise": 0.01,
        "encoder_noise": 0.002,
        "encoder_speed_noise": 0.03,
    }

    def read(seed):
        units = sensors(seed, **asked)
        readings = [units.read(motion(), k * STEP) for k in range(2000)]
        forces = np.array([imus[0].specific_force for imus, _ in readings])
        spins = np.array([imus[1].angular_velocity for imus, _ in readings])
        angles = np.array([encoders.angles for _, encoders in readings])
        speeds = np.array([encoders.speeds for _, encoders in readings])
        return forces - [0.0, 0.0, 9.81], spins, angles - motion().joint_positions, speeds

    for errors, size in zip(read(1), asked.values(), strict=True):
        assert errors.std() == pytest.approx(size, rel=0.05)
        assert abs(errors.mean()) < 4.0 * size / math.sqrt(errors.size)
    for one, same, other in zip(read(1), read(1), read(2), strict=True):
        np.testing.assert_array_equal(one, same)
        assert (one != other).any()


def test_bias_is_constant_in_a_run_and_differs_between_seeds():
    def bias(seed):
        units = sensors(seed, accelerometer_bias=0.1, gyro_bias=0.01)
        first, later = (units.read(motion(), k * STEP)[0][0] for k in range(2))
        np.testing.assert_array_equal(first.specific_force, later.specific_force)
        return np.concatenate([first.specific_force - [0.0, 0.0, 9.81], first.angular_velocity])

    biases = np.array([bias(seed) for seed in range(200)])
    assert biases[:, :3].std() == pytest.approx(0.1, rel=0.15)
    assert biases[:, 3:].std() == pytest.approx(0.01, rel=0.15)


def test_machine_without_inertial_units_has_encoders():
    readings, encoders = Sensors(replace(MACHINE, imus=()), SensorParams(), 0).read(motion(), 0.0)
    assert readings == []
    np.testing.assert_array_equal(encoders.angles, motion().joint_positions)

"""Visual parts of cylinders: rods and couplers end at their pins at all joint angles."""

import numpy as np
import pytest

from machine_sim.machine import EXCAVATOR_JOINTS, rotation_matrix
from machine_sim.machine.cylinder_visuals import (
    cylinder_joint_states,
    cylinder_joint_values,
    cylinder_parts,
)
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses


def poses_at(spec, joints):
    """Return rotation and origin by frame, for a base with an arbitrary rotation."""
    poses = link_poses(spec, [1.0, 2.0, 3.0], [0.1, -0.2, 0.3, 0.9], joints)
    return {
        name: (rotation_matrix(quaternion), origin)
        for name, origin, quaternion in zip(link_frame_names(spec), *poses, strict=True)
    }


def random_joints(spec, count):
    rng = np.random.default_rng(1)
    for _ in range(count):
        yield [
            rng.uniform(max(limit.lower, -3.0), min(limit.upper, 3.0))
            for limit in spec.joints.values()
        ]


def test_rods_and_couplers_end_at_their_pins(spec):
    for joints in random_joints(spec, 50):
        at = poses_at(spec, joints)
        for name, rods in (("boom", ("boom_rod_left", "boom_rod_right")), ("arm", ("arm_rod",))):
            rotation, origin = at[name]
            x, z = spec.cylinders[name].linkage.rod
            for rod in rods:
                local = rotation.T @ (at[rod][1] - origin)
                np.testing.assert_allclose(local[[0, 2]], [x, z], atol=1e-9)
        rocker = spec.cylinders["bucket"].linkage.rocker
        rotation, origin = at["bucket_coupler"]
        end = origin + rotation @ [rocker.coupler_length, 0.0, 0.0]
        rotation, origin = at["bucket"]
        coupler_pin = [rocker.coupler_pin[0], 0.0, rocker.coupler_pin[1]]
        np.testing.assert_allclose(rotation.T @ (end - origin), coupler_pin, atol=1e-9)
        np.testing.assert_allclose(at["bucket_rod"][1], at["bucket_coupler"][1], atol=1e-9)


def test_boom_cylinders_are_on_both_sides(spec):
    left, right = (part for part in cylinder_parts(spec) if part.link.startswith("boom_barrel"))
    assert left.origin[1] == -right.origin[1] == pytest.approx(0.31)
    assert right.mimic == left.joint


def test_rods_remain_in_their_barrels(spec):
    parts = {part.link: part for part in cylinder_parts(spec)}
    for rod, barrel in (("boom_rod_left", "boom_barrel_left"), ("arm_rod", "arm_barrel")):
        tube = parts[barrel].box.size[0]
        reach = parts[rod].box.size[0]
        assert parts[rod].upper - reach < tube
        assert parts[rod].lower > tube, "the rod's eye is outside at the shortest"


def test_velocities_are_derivatives_of_positions(spec):
    joints, rates = [0.2, -0.3, 1.5, 0.8], [0.0, 0.3, -0.4, 0.5]
    state = cylinder_joint_states(spec, joints, rates)
    step = 1e-6
    later = [angle + step * rate for angle, rate in zip(joints, rates, strict=True)]
    later_state = cylinder_joint_states(spec, later, rates)
    derivative = (np.array(later_state.positions) - state.positions) / step
    np.testing.assert_allclose(state.velocities, derivative, atol=1e-3)
    arm = spec.cylinders["arm"].linkage
    assert state.velocities[state.names.index("arm_rod_stroke")] == pytest.approx(
        arm.lever_arm(joints[EXCAVATOR_JOINTS.index("arm")]) * rates[2], rel=1e-3
    )


def test_every_part_has_a_joint_value(spec):
    values = cylinder_joint_values(spec, [0.0, 0.0, 1.5, 0.0])
    assert len(values) == len(cylinder_parts(spec))

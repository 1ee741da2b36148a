"""Cylinder linkages: angle to length and back, lever arms, invalid geometry."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from machine_sim.machine import MachineError
from machine_sim.machine.cylinder_linkage import CylinderLinkage, Rocker
from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.hydraulic_tables import cylinder_table
from machine_sim.machine.linkage_kernels import length_and_lever_arm

DIRECT = CylinderLinkage((0.15, 0.75), (0.62, 0.15), (2.45, 0.62), None, -1.05, 0.85)
FOUR_BAR = CylinderLinkage(
    (2.9, 0.0), (0.24, 0.41), None, Rocker((2.58, 0.10), 0.66, 0.62, (-0.17, 0.34)), -0.6, 2.3
)
BOTH = pytest.mark.parametrize("linkage", [DIRECT, FOUR_BAR], ids=["direct", "four-bar"])


def angles(linkage, count=401):
    return np.linspace(linkage.lower, linkage.upper, count).tolist()


@BOTH
def test_angle_of_length_inverts_length_of_angle(linkage):
    for angle in angles(linkage):
        assert linkage.angle(linkage.length(angle)) == pytest.approx(angle, abs=1e-9)


@BOTH
def test_length_of_angle_inverts_angle_of_length(linkage):
    for length in np.linspace(linkage.min_length, linkage.max_length, 200).tolist():
        assert linkage.length(linkage.angle(length)) == pytest.approx(length, abs=1e-9)


def test_cylinders_of_the_excavator_invert_angle_and_length(spec):
    for cylinder in spec.cylinders.values():
        linkage = cylinder.linkage
        for angle in angles(linkage, 1001):
            assert linkage.angle(linkage.length(angle)) == pytest.approx(angle, abs=1e-9, rel=0.0)


@BOTH
def test_lever_arm_is_the_derivative_of_length(linkage):
    step = 1e-6
    for angle in angles(linkage, 60)[1:-1]:
        derivative = (linkage.length(angle + step) - linkage.length(angle - step)) / (2.0 * step)
        assert linkage.lever_arm(angle) == pytest.approx(derivative, rel=1e-6)


@BOTH
def test_rods_rockers_and_couplers_have_constant_lengths(linkage):
    for angle in angles(linkage, 60):
        barrel, rod, coupler_pin = linkage.pins(angle)
        assert math.dist(barrel, rod) == pytest.approx(linkage.length(angle), abs=1e-12)
        if linkage.rocker is None:
            assert math.dist(linkage.joint, rod) == pytest.approx(math.hypot(*linkage.rod))
        else:
            assert math.dist(linkage.rocker.pin, rod) == pytest.approx(linkage.rocker.length)
            assert math.dist(rod, coupler_pin) == pytest.approx(linkage.rocker.coupler_length)
            assert math.dist(linkage.joint, coupler_pin) == pytest.approx(
                math.hypot(*linkage.rocker.coupler_pin)
            )


def test_length_outside_the_limits_is_rejected():
    with pytest.raises(MachineError, match=r"outside the joint's limits; give 1\.81"):
        DIRECT.angle(4.0)


def test_dead_centre_within_the_limits_is_rejected():
    with pytest.raises(MachineError, match=r"dead centre at .* move a pin"):
        replace(DIRECT, upper=1.6)


def test_coupler_that_is_too_short_is_rejected():
    short = replace(FOUR_BAR.rocker, coupler_length=0.3)
    with pytest.raises(MachineError, match="do not reach each other at"):
        replace(FOUR_BAR, rocker=short)


def test_linkage_with_rod_and_rocker_is_rejected():
    with pytest.raises(MachineError, match="give one"):
        replace(FOUR_BAR, rod=(0.1, 0.1))


@njit
def _length_and_lever_arm(cylinder, angle):
    return length_and_lever_arm(cylinder, angle)


@BOTH
def test_kernel_gives_the_same_bits_and_keeps_to_the_range(linkage):
    (row,) = cylinder_table(["arm"], {"arm": Cylinder(linkage, 0.1, 0.05, 1, 0.0, 0.1, 0.01)})
    for angle in angles(linkage):
        assert _length_and_lever_arm(row, angle) == linkage.length_and_lever_arm(angle)
    beyond = _length_and_lever_arm(row, linkage.upper + 0.1)
    assert beyond == linkage.length_and_lever_arm(linkage.upper)

"""URDF text, parsed as robot_state_publisher does."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from machine_sim.machine import urdf_text
from machine_sim.machine.urdf import BASE_JOINTS


def tree(text):
    """Return the root element, the link names and the parent by child of a URDF."""
    robot = ET.fromstring(text)
    links = [link.get("name") for link in robot.iter("link")]
    parents = {
        joint.find("child").get("link"): joint.find("parent").get("link")
        for joint in robot.iter("joint")
    }
    return robot, links, parents


def test_links_form_one_chain(spec):
    _, links, parents = tree(urdf_text(spec))
    assert links == ["base_link", "upper", "boom", "arm", "bucket"]
    assert parents == {"upper": "base_link", "boom": "upper", "arm": "boom", "bucket": "arm"}


def test_joint_limits_are_those_of_the_specification(spec):
    robot, _, _ = tree(urdf_text(spec))
    for joint in robot.iter("joint"):
        limits, limit = spec.joints[joint.get("name")], joint.find("limit")
        assert float(limit.get("effort")) == limits.max_effort
        assert joint.get("type") == ("revolute" if math.isfinite(limits.lower) else "continuous")
        if math.isfinite(limits.lower):
            assert (float(limit.get("lower")), float(limit.get("upper"))) == (
                limits.lower,
                limits.upper,
            )


def test_masses_add_up(spec):
    robot, _, _ = tree(urdf_text(spec))
    masses = [float(mass.get("value")) for mass in robot.iter("mass")]
    assert sum(masses) == spec.mass


def test_only_primitive_shapes(spec):
    robot, _, _ = tree(urdf_text(spec))
    shapes = {shape.tag for geometry in robot.iter("geometry") for shape in geometry}
    assert shapes == {"box"}


def test_virtual_base_connects_the_machine_to_map(spec):
    robot, links, parents = tree(urdf_text(spec, prefix="digger/", virtual_base=True))
    link, ancestors = "digger/bucket", []
    while link in parents:
        link = parents[link]
        ancestors.append(link)
    assert link == "map"
    assert len(ancestors) == len(links) - 1
    assert [j.get("name") for j in robot.iter("joint")][:6] == list(BASE_JOINTS)


def test_boxes_of_the_bucket_follow_its_profile(spec):
    """The box of each floor strip ends at two profile points."""
    robot, _, _ = tree(urdf_text(spec))
    bucket = next(link for link in robot.iter("link") if link.get("name") == "bucket")
    profile = spec.bucket.profile
    for visual, a, b in zip(
        list(bucket.iter("visual"))[:6], profile[:-1], profile[1:], strict=True
    ):
        x, _, z = map(float, visual.find("origin").get("xyz").split())
        pitch = float(visual.find("origin").get("rpy").split()[1])
        half = 0.5 * float(visual.find("geometry/box").get("size").split()[0])
        along = half * np.array([math.cos(pitch), -math.sin(pitch)])
        assert np.array([x, z]) - along == pytest.approx(a)
        assert np.array([x, z]) + along == pytest.approx(b)

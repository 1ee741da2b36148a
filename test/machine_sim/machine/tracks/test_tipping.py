"""A machine tips as statics has it: about the axles of its tracks, or their outer edges."""

import dataclasses
import math

import numpy as np
import pytest

from machine_sim.machine.tracks.shoe_contact import CONTACT_WIDTH_FRACTION
from msg_bridge.contract.constants import GRAVITY

TILT_OF_A_TIPPING_MACHINE = math.radians(8.0)
REACH = (0.0, -0.1, 0.8, 0.3)
"""Joint angles of an arm stretched out over the front [rad]."""


def center_of_mass(scene):
    """Return the centre of mass of the whole machine in the base frame [m], shape (3,)."""
    client, weighted, total = scene.client, np.zeros(3), 0.0
    bodies = [scene.machine.body]
    bodies += [i for i in range(client.getNumBodies()) if i != scene.machine.body]
    for body in bodies:
        for link in range(-1, client.getNumJoints(body)):
            mass = client.getDynamicsInfo(body, link)[0]
            pose = client.getBasePositionAndOrientation(body)
            position = pose[0] if link < 0 else client.getLinkState(body, link)[0]
            weighted, total = weighted + mass * np.array(position), total + mass
    position, quaternion = scene.machine.base_pose
    rotation = np.array(client.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
    return rotation.T @ (weighted / total - position)


def lever_arm(spec, com, direction):
    """Return the horizontal distance of a centre of mass from the tipping line [m]."""
    tracks = spec.tracks
    half_width = 0.5 * (tracks.gauge + CONTACT_WIDTH_FRACTION * tracks.shoe_width)
    return {
        "front": 0.5 * tracks.axle_distance - com[0],
        "rear": 0.5 * tracks.axle_distance + com[0],
        "left": half_width - com[1],
    }[direction]


@pytest.mark.parametrize("tracks", ["kinematic", "dynamic"])
@pytest.mark.parametrize("direction", ["front", "rear", "left"])
def test_slope_at_which_it_tips_is_that_of_statics(scene, spec, direction, tracks):
    """Gravity turns by one degree a second, as on a slope that grows steeper."""
    no_slip = dataclasses.replace(spec, tracks=dataclasses.replace(spec.tracks, friction=3.0))
    s = scene(spec=no_slip, tracks=tracks)
    s.run(2.0)
    com = center_of_mass(s)
    expected = math.degrees(math.atan2(lever_arm(spec, com, direction), com[2]))
    downhill = {"front": (1.0, 0.0), "rear": (-1.0, 0.0), "left": (0.0, 1.0)}[direction]
    angle = expected - 5.0
    while s.machine.tilt < TILT_OF_A_TIPPING_MACHINE and angle < expected + 5.0:
        angle += s.dt
        pull = GRAVITY * math.sin(math.radians(angle)) * np.array(downhill)
        s.client.setGravity(*pull, -GRAVITY * math.cos(math.radians(angle)))
        s.step()
    assert angle == pytest.approx(expected, abs=2.0)


@pytest.mark.parametrize("tracks", ["kinematic", "dynamic"])
@pytest.mark.parametrize("swing", [0.0, math.pi, 0.5 * math.pi])
def test_load_at_which_it_tips_is_that_of_statics(scene, spec, swing, tracks):
    """A load at the bucket grows until the machine tips over the front, the rear, or a side."""
    home = np.array([swing, *REACH[1:]])
    s = scene(spec=dataclasses.replace(spec, home=home), tracks=tracks)
    s.run(2.0)
    com = center_of_mass(s)
    point = np.array(s.machine.tool.pose[1]) - s.position
    direction = {0.0: "front", math.pi: "rear"}.get(swing, "left")
    reach = abs(point[0 if direction != "left" else 1])
    line = lever_arm(spec, np.zeros(3), direction)
    expected = spec.mass * GRAVITY * lever_arm(spec, com, direction) / (reach - line)
    load = 0.85 * expected
    while s.machine.tilt < TILT_OF_A_TIPPING_MACHINE and load < 1.15 * expected:
        load += 0.02 * expected * s.dt
        s.machine.tool.push([0.0, 0.0, -load], np.zeros(3), s.machine.tool.pose[1])
        s.step()
    assert load == pytest.approx(expected, rel=0.05)

"""machine_outline: the machine from above in its pose."""

import numpy as np
import pytest
from support.machine_scenes import excavator
from support.operator_scenes import tilted

from earthmoving_sim.machine_outline import machine_outline
from machine_sim.machine.rotations import rotation_about_z

MACHINE = excavator()
POSITION = np.array([3.0, -2.0, 0.5])
ROTATION = tilted(roll=0.05, pitch=-0.1, yaw=0.8)
POSE = (POSITION, ROTATION, [0.7, -0.4, 1.3, 1.1])


def encloses(polygon: np.ndarray, point: np.ndarray) -> bool:
    """Return whether a point (2,) lies inside a convex polygon (k, 2)."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    offset = point - polygon
    side = edge[:, 0] * offset[:, 1] - edge[:, 1] * offset[:, 0]
    return bool((side > 0).all() or (side < 0).all())


def test_outline_has_tracks_and_upper_body():
    names = [name for name, _ in machine_outline(MACHINE, *POSE)]
    assert names.count("base") == len(MACHINE.links["base"].boxes)
    assert names.count("upper") == len(MACHINE.links["upper"].boxes)


def test_outline_encloses_the_position_of_the_machine():
    enclosing = [p for name, p in machine_outline(MACHINE, *POSE) if encloses(p, POSITION[:2])]
    assert enclosing
    assert not any(
        encloses(polygon, POSITION[:2] + 10.0) for _, polygon in machine_outline(MACHINE, *POSE)
    )


def test_tracks_lie_on_both_sides_of_the_middle():
    outline = [polygon for name, polygon in machine_outline(MACHINE, *POSE) if name == "base"]
    left = ROTATION[:2, 1]
    sides = sorted((polygon.mean(axis=0) - POSITION[:2]) @ left for polygon in outline)
    assert sides[0] < -0.8
    assert sides[-1] > 0.8


@pytest.mark.parametrize("swing", [0.0, 2.0])
def test_upper_body_turns_with_the_swing_and_the_tracks_do_not(swing):
    level = (np.zeros(3), np.eye(3))
    before = machine_outline(MACHINE, *level, [0.0, 0.0, 1.0, 0.0])
    after = machine_outline(MACHINE, *level, [swing, 0.0, 1.0, 0.0])
    turn = rotation_about_z(swing)[:2, :2]
    for (name, old), (_, new) in zip(before, after, strict=True):
        np.testing.assert_allclose(new, old @ turn.T if name == "upper" else old, atol=1e-9)

"""What a force on the tool does to the machine, on tracks of either kind."""

import numpy as np
import pytest

from machine_sim.machine.tracks.track_model import TRACK_MODELS

from .conftest import DT

BOTH = pytest.mark.parametrize("tracks", TRACK_MODELS)
STILL = [0.0, 0.0]


def reach(s, boom, arm, bucket):
    """Take the joints to these angles [rad] and let the machine come to rest."""
    for _ in range(round(6.0 / DT)):
        off = np.array([0.0, boom, arm, bucket]) - s.machine.joint_positions
        s.machine.command(np.clip(3.0 * off, -0.4, 0.4), STILL)
        s.step()
    s.machine.command([0.0] * 4, STILL)
    s.run(1.0)


@BOTH
@pytest.mark.parametrize(("force", "drags"), [(100e3, False), (150e3, True)])
def test_a_pull_drags_the_base_once_it_beats_the_grip(scene, tracks, force, drags):
    """The machine weighs 179 kN and its shoes hold 0.8 of that."""
    s = scene(tracks=tracks)
    reach(s, 0.05, 1.55, 1.2)  # the bucket's pin near the ground, the arm upright
    start, ground = s.place, []
    for k in range(600):
        s.machine.tool.push([min(1.0, k / 200) * force, 0.0, 0.0], np.zeros(3))
        s.step()
        ground.append(s.machine.tracks.wrench[0])
    moved = (s.place - start)[0]
    assert moved > 0.5 if drags else moved < 0.03
    held = min(force, 0.8 * 9.81 * s.machine.spec.mass)
    assert np.mean(ground[400:]) == pytest.approx(-held, rel=0.05)


@BOTH
def test_a_heavy_load_at_full_reach_tips_the_machine_over_a_sill(scene, tracks):
    """2.4 t over a sill of 0.25 m, and nothing below the bucket that would catch it."""

    def sill(x, y):
        return np.where((x > 3.0) & (x < 3.6), 0.25, 0.0)

    s = scene(sill, tracks=tracks)
    reach(s, -0.35, 0.62, 0.9)
    s.machine.command([0.0] * 4, [0.8, 0.8])
    tilts = []
    while not s.machine.overturned and len(tilts) < round(8.0 / DT):
        rotation, origin = s.machine.tool.pose
        s.machine.tool.push(
            [0.0, 0.0, -2400.0 * 9.81], np.zeros(3), origin + rotation @ [0.8, 0.0, 0.3]
        )
        s.step()
        tilts.append(s.machine.tilt)
    assert s.machine.overturned
    assert tilts[0] < 0.1
    assert tilts[-1] > 1.0
    assert np.abs(np.diff(tilts)).max() < 0.05  # it goes over, it is not thrown

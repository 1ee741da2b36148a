"""Forces on the tool drag or overturn the machine, with both track models."""

import numpy as np
import pytest

from machine_sim.machine.tracks.track_model import TRACK_MODELS

from .conftest import DT

BOTH = pytest.mark.parametrize("tracks", TRACK_MODELS)
STILL = [0.0, 0.0]


def move_arm(s, boom, arm, bucket):
    """Move the joints to these angles [rad] and wait until the machine is at rest."""
    for _ in range(round(6.0 / DT)):
        error = np.array([0.0, boom, arm, bucket]) - s.machine.joint_positions
        s.machine.command(np.clip(3.0 * error, -0.4, 0.4), STILL)
        s.step()
    s.machine.command([0.0] * 4, STILL)
    s.run(1.0)


@BOTH
@pytest.mark.parametrize(("force", "is_dragged"), [(120e3, False), (180e3, True)])
def test_pull_drags_the_base_above_the_friction_limit(scene, tracks, force, is_dragged):
    """The machine weighs 210 kN, and the friction coefficient of its shoes is 0.8."""
    s = scene(tracks=tracks)
    move_arm(s, 0.05, 1.55, 1.2)  # the bucket's pin near the ground, the arm upright
    start, ground_forces = s.position, []
    for k in range(600):
        s.machine.tool.push([min(1.0, k / 200) * force, 0.0, 0.0], np.zeros(3))
        s.step()
        ground_forces.append(s.machine.tracks.wrench[0])
    moved = (s.position - start)[0]
    assert moved > 0.5 if is_dragged else moved < 0.03
    expected = min(force, 0.8 * 9.81 * s.machine.spec.mass)
    assert np.mean(ground_forces[400:]) == pytest.approx(-expected, rel=0.05)


@BOTH
def test_heavy_load_at_full_reach_overturns_the_machine_on_a_sill(scene, tracks):
    """A load of 3.2 t, a sill of 0.25 m, and no contact of the bucket with the ground."""

    def sill(x, y):
        return np.where((x > 3.0) & (x < 3.6), 0.25, 0.0)

    s = scene(sill, tracks=tracks)
    move_arm(s, -0.35, 0.62, 0.9)
    s.machine.command([0.0] * 4, [0.8, 0.8])
    tilts = []
    while not s.machine.overturned and len(tilts) < round(8.0 / DT):
        rotation, origin = s.machine.tool.pose
        s.machine.tool.push(
            [0.0, 0.0, -3200.0 * 9.81], np.zeros(3), origin + rotation @ [0.8, 0.0, 0.3]
        )
        s.step()
        tilts.append(s.machine.tilt)
    assert s.machine.overturned
    assert tilts[0] < 0.1
    assert tilts[-1] > 1.0
    assert np.abs(np.diff(tilts)).max() < 0.05  # it tips gradually

"""Milling resistance: it brakes a drum and pushes it out, and never drives it."""

import numpy as np
import pytest

from machine_sim.machine import MachineError
from machine_sim.tool_soil.milling_resistance import MillingResistance
from machine_sim.tool_soil.resistance import FORCE_TIMEOUT_TICKS
from msg_bridge.contract.rows import FORCE, Rows, SoilReaction, empty_rows

DT = 0.005
INERTIA = 200.0
POSE = (np.eye(3), np.array([1.0, 2.0, 3.0]))


def milling() -> MillingResistance:
    return MillingResistance(1400.0, 24_000.0, INERTIA, DT)


def answer(force=(-20e3, 0.0, 10e3), torque=(0.0, -8e3, 0.0), reaction=SoilReaction.MILL) -> Rows:
    """Return a FORCE row for a drum at `POSE` that spins about +y."""
    rows = empty_rows(FORCE, 1)
    rows["x"], rows["y"], rows["z"] = POSE[1]
    rows["fx"], rows["fy"], rows["fz"] = force
    rows["tx"], rows["ty"], rows["tz"] = torque
    rows["reaction"] = reaction
    return rows


def wrench_on(drum: MillingResistance, spin: float) -> tuple[np.ndarray, np.ndarray]:
    return drum.step(POSE, (np.zeros(3), np.array([0.0, spin, 0.0])), DT)


def test_spinning_drum_has_the_whole_wrench_until_it_expires() -> None:
    drum = milling()
    drum.receive(answer(), POSE)
    force, torque = wrench_on(drum, 5.0)
    assert force == pytest.approx([-20e3, 0.0, 10e3])
    assert torque == pytest.approx([0.0, -8e3, 0.0])
    for _ in range(FORCE_TIMEOUT_TICKS):
        drum.begin_tick()
    assert drum.is_active
    drum.begin_tick()
    assert not drum.is_active
    assert not np.any(wrench_on(drum, 5.0))


def test_resistance_never_drives_a_drum() -> None:
    drum = milling()
    drum.receive(answer(torque=(0.0, -1e6, 0.0)), POSE)
    for spin in (0.0, -3.0):
        assert not np.any(wrench_on(drum, spin))
    spin = 5.0
    for _ in range(40):  # by explicit steps, as the physics engine does
        spin += wrench_on(drum, spin)[1][1] / INERTIA * DT
        assert spin >= 0.0
    assert spin < 0.1


def test_contact_point_moves_with_the_drum() -> None:
    drum = milling()
    rows = answer(torque=(0.0, 0.0, 0.0))
    rows["x"] += 0.5  # force at the front of the drum, upward: against a spin about +y
    rows["fx"], rows["fz"] = 0.0, 10e3
    drum.receive(rows, POSE)
    force, torque = wrench_on(drum, 5.0)
    assert force == pytest.approx([0.0, 0.0, 10e3])
    assert torque == pytest.approx([0.0, -5e3, 0.0])


def test_drum_at_rest_is_supported() -> None:
    drum = milling()
    drum.receive(
        answer(force=(0.0, 0.0, 50e3), torque=(0, 0, 0), reaction=SoilReaction.BEARING), POSE
    )
    sinking = (np.array([0.0, 0.0, -0.2]), np.zeros(3))
    assert drum.step(POSE, sinking, DT)[0][2] > 0.0


def test_bearing_reaction_ends_when_the_drum_mills() -> None:
    drum = milling()
    drum.receive(
        answer(force=(0.0, 0.0, 50e3), torque=(0, 0, 0), reaction=SoilReaction.BEARING), POSE
    )
    drum.receive(answer(), POSE)
    force, _ = drum.step(POSE, (np.array([0.0, 0.0, -0.2]), np.array([0.0, 5.0, 0.0])), DT)
    assert force == pytest.approx([-20e3, 0.0, 10e3])


def test_wrench_that_is_not_finite_is_rejected() -> None:
    drum = milling()
    drum.receive(answer(), POSE)
    with pytest.raises(MachineError, match="give finite"):
        drum.receive(answer(force=(np.nan, 0.0, 0.0)), POSE)
    assert wrench_on(drum, 5.0)[0][0] == pytest.approx(-20e3)

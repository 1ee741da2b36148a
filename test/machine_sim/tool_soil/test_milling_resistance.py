"""What a drum feels of what it mills: it is braked and pushed out, and never driven."""

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


def answer(force=(-20e3, 0.0, 10e3), torque=(0.0, -8e3, 0.0), holds=SoilReaction.MILL) -> Rows:
    """The soil's word on a drum that turns about +y at `POSE`."""
    rows = empty_rows(FORCE, 1)
    rows["x"], rows["y"], rows["z"] = POSE[1]
    rows["fx"], rows["fy"], rows["fz"] = force
    rows["tx"], rows["ty"], rows["tz"] = torque
    rows["reaction"] = holds
    return rows


def felt(what: MillingResistance, spin: float) -> tuple[np.ndarray, np.ndarray]:
    return what.step(POSE, (np.zeros(3), np.array([0.0, spin, 0.0])), DT)


def test_a_drum_that_spins_feels_all_of_it_until_the_soil_lapses() -> None:
    drum = milling()
    drum.receive(answer(), POSE)
    force, torque = felt(drum, 5.0)
    assert force == pytest.approx([-20e3, 0.0, 10e3])
    assert torque == pytest.approx([0.0, -8e3, 0.0])
    for _ in range(FORCE_TIMEOUT_TICKS):
        drum.begin_tick()
    assert drum.is_active
    drum.begin_tick()
    assert not drum.is_active
    assert not np.any(felt(drum, 5.0))


def test_what_resists_never_turns_a_drum() -> None:
    drum = milling()
    drum.receive(answer(torque=(0.0, -1e6, 0.0)), POSE)
    for spin in (0.0, -3.0):
        assert not np.any(felt(drum, spin))
    spin = 5.0
    for _ in range(40):  # by explicit steps, as the physics engine does
        spin += felt(drum, spin)[1][1] / INERTIA * DT
        assert spin >= 0.0
    assert spin < 0.1


def test_the_wrench_goes_with_the_drums_frame() -> None:
    drum = milling()
    rows = answer(torque=(0.0, 0.0, 0.0))
    rows["x"] += 0.5  # force at the front of the drum, upward: against a spin about +y
    rows["fx"], rows["fz"] = 0.0, 10e3
    drum.receive(rows, POSE)
    force, torque = felt(drum, 5.0)
    assert force == pytest.approx([0.0, 0.0, 10e3])
    assert torque == pytest.approx([0.0, -5e3, 0.0])


def test_a_drum_that_stands_is_borne() -> None:
    drum = milling()
    drum.receive(answer(force=(0.0, 0.0, 50e3), torque=(0, 0, 0), holds=SoilReaction.BEARING), POSE)
    sinking = (np.array([0.0, 0.0, -0.2]), np.zeros(3))
    assert drum.step(POSE, sinking, DT)[0][2] > 0.0


def test_what_bore_a_drum_is_gone_once_it_mills() -> None:
    drum = milling()
    drum.receive(answer(force=(0.0, 0.0, 50e3), torque=(0, 0, 0), holds=SoilReaction.BEARING), POSE)
    drum.receive(answer(), POSE)
    force, _ = drum.step(POSE, (np.array([0.0, 0.0, -0.2]), np.array([0.0, 5.0, 0.0])), DT)
    assert force == pytest.approx([-20e3, 0.0, 10e3])


def test_a_wrench_that_is_not_finite_is_refused() -> None:
    drum = milling()
    drum.receive(answer(), POSE)
    with pytest.raises(MachineError, match="give finite"):
        drum.receive(answer(force=(np.nan, 0.0, 0.0)), POSE)
    assert felt(drum, 5.0)[0][0] == pytest.approx(-20e3)

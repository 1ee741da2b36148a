"""Milling resistance: it takes the milled work out of the drum, stalls it, and never drives it."""

from dataclasses import dataclass

import numpy as np
import pytest

from machine_sim.machine import MachineError
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.capped_spring_damper import DISPLACEMENT, MAX_FORCE
from machine_sim.tool_soil.milling_resistance import MillingResistance
from machine_sim.tool_soil.resistance import FORCE_TIMEOUT_TICKS
from msg_bridge.contract.rows import FORCE, Rows, SoilReaction, empty_rows

PARAMS = MachineSimParams()
DT, TICK = PARAMS.physics_step, PARAMS.tick_period
SHAPE = DrumShape(0.5, 0.4, 1.2)
POSE = (np.eye(3), np.array([1.0, 2.0, 3.0]))
FRONT = (0.5, 0.0, 0.0)
DRIVE_TORQUE, INERTIA, SPEED = 15e3, 150.0, 7.0


@dataclass
class Drum:
    """A drum on its drive, without an arm.

    The drive exerts its maximum torque below the commanded speed, as a motor with velocity control.
    """

    mass: float = 1400.0
    inertia: float = INERTIA
    drum_torque: float = DRIVE_TORQUE
    drum_speed: float = SPEED
    commanded_drum_speed: float = SPEED
    drive_work: float = 0.0

    def step(self, braking_torque: float) -> None:
        needed = self.inertia * (self.commanded_drum_speed - self.drum_speed) / DT
        drive = min(max(needed - braking_torque, -self.drum_torque), self.drum_torque)
        before = self.drum_speed
        self.drum_speed += (drive + braking_torque) / self.inertia * DT
        self.drive_work += drive * 0.5 * (before + self.drum_speed) * DT

    @property
    def energy(self) -> float:
        return 0.5 * self.inertia * self.drum_speed**2


def milling(drum: Drum) -> MillingResistance:
    return MillingResistance(drum, SHAPE, 24_000.0, PARAMS)  # type: ignore[arg-type]


def answer(work: float = 0.0, remaining: float = 0.0, point=FRONT, direction=(-1, 0, 0)) -> Rows:
    """Return the FORCE rows for a drum at `POSE`: work [J], strength of remaining soil [N]."""
    rows = empty_rows(FORCE, 2 if remaining else 1)
    for name, value in zip("xyz", POSE[1] + point, strict=True):
        rows[name] = value
    strength = np.array([1e6, remaining])[: rows.size]
    for name, value in zip(("fx", "fy", "fz"), direction, strict=True):
        rows[name] = value * strength
    rows["reaction"] = [SoilReaction.MILL, SoilReaction.BEARING][: rows.size]
    rows["work"][0] = work
    return rows


def run_tick(drum: Drum, soil: MillingResistance, rows: Rows | None, feed: float = 0.0) -> list:
    """Advance a tick in which the drum is fed forward [m/s]; return the wrenches of its steps."""
    if rows is not None:
        soil.receive(rows, POSE)
    soil.begin_tick()
    wrenches = []
    for _ in range(PARAMS.steps_per_tick):
        velocity = ((feed, 0.0, 0.0), (0.0, drum.drum_speed, 0.0))
        wrenches.append(soil.step(POSE, velocity, DT))
        drum.step(float(wrenches[-1][1][1]))
    return wrenches


def test_drum_at_speed_can_deliver_the_work_of_its_drive() -> None:
    drum = Drum()
    assert milling(drum).deliverable_work >= DRIVE_TORQUE * SPEED * TICK
    assert milling(drum).deliverable_work < 1.3 * DRIVE_TORQUE * SPEED * TICK
    assert milling(Drum(commanded_drum_speed=0.0)).deliverable_work <= Drum().energy
    assert milling(Drum(drum_speed=0.2)).deliverable_work == 0.0


def test_picks_take_exactly_the_milled_work_out_of_the_drum() -> None:
    drum = Drum()
    soil = milling(drum)
    energy, used = drum.energy, 0.0
    for k in range(60):
        work = 600.0 if k % 3 else 1400.0
        used += work if k < 50 else 0.0
        run_tick(drum, soil, answer(work if k < 50 else 0.0))
    assert used > 30e3
    assert drum.drive_work - (drum.energy - energy) == pytest.approx(used, rel=1e-3)
    assert soil.debt == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("other_torque", [0.0, 4e3])
def test_soil_that_takes_all_work_slows_the_drum_a_little(other_torque: float) -> None:
    """Answers lag by two ticks; cuttings may brake the drum besides."""
    drum = Drum()
    soil = milling(drum)
    reported: list[float] = [0.0, 0.0]
    speeds, used = [], 0.0
    for _ in range(600):
        work = reported[-2]
        used += work
        drum.drum_torque = DRIVE_TORQUE - other_torque
        run_tick(drum, soil, answer(work))
        drum.drum_torque = DRIVE_TORQUE
        reported.append(soil.deliverable_work)
        speeds.append(drum.drum_speed)
    low = 0.85 if other_torque == 0.0 else 0.4
    assert low * SPEED < min(speeds[300:]) <= max(speeds[300:]) < 1.01 * SPEED
    assert np.ptp(speeds[500:]) < 0.05 * SPEED
    assert used / (600 * TICK) > low * SPEED * (DRIVE_TORQUE - other_torque) * 0.95


def test_picks_that_are_pressed_too_hard_stall_the_drum_and_release_it() -> None:
    drum = Drum()
    soil = milling(drum)
    for _ in range(300):  # 40 kN at 0.5 m: 20 kN m, above the drive's 15 kN m
        soil.contact[DISPLACEMENT] = 0.0
        run_tick(drum, soil, answer(remaining=40e3), feed=1.0)
    assert 0.0 <= drum.drum_speed < 0.5
    assert soil.deliverable_work == 0.0
    for _ in range(100):
        run_tick(drum, soil, answer(), feed=-0.1)
    assert drum.drum_speed == pytest.approx(SPEED, rel=0.01)


def test_soil_that_remains_stops_the_feed() -> None:
    soil = milling(Drum())
    drum = Drum()
    forces = [force for _ in range(20) for force, _ in run_tick(drum, soil, answer(0, 1e7), 0.02)]
    assert forces[-1][0] < -50e3  # 8 mm of a stiff contact
    assert soil.contact[DISPLACEMENT] == pytest.approx(20 * 0.02 * TICK)
    run_tick(drum, soil, answer(100.0))
    assert soil.contact[MAX_FORCE] < 10e3  # the thrust on the picks


def test_cutting_force_is_against_the_motion_of_the_picks() -> None:
    """The front of a drum that spins about +y moves down: the soil pushes it up."""
    drum = Drum()
    soil = milling(drum)
    (force, torque), *_ = run_tick(drum, soil, answer(700.0))
    braking = 700.0 / TICK / SPEED
    assert torque[1] == pytest.approx(-braking, rel=0.01)
    assert force[2] == pytest.approx(braking / 0.5, rel=0.01)


def test_torque_does_not_depend_on_the_lever_of_the_contact() -> None:
    drum = Drum()
    soil = milling(drum)
    rows = answer(700.0, point=(0.0, 0.6, 0.01), direction=(0, -1, 0))
    (force, torque), *_ = run_tick(drum, soil, rows)
    assert torque[1] == pytest.approx(-700.0 / TICK / SPEED, rel=0.01)
    assert np.linalg.norm(force) < 1.1 * 700.0 / TICK / SPEED / (0.3 * SHAPE.radius)


@pytest.mark.parametrize("commanded", [SPEED, 0.0, -SPEED])
def test_resistance_never_drives_a_drum(commanded: float) -> None:
    for speed in (0.0, -3.0, 3.0):
        drum = Drum(drum_speed=speed, commanded_drum_speed=commanded, drum_torque=0.0)
        soil = milling(drum)
        for _ in range(40):
            before = drum.drum_speed
            run_tick(drum, soil, answer(1e5, 1e7), feed=0.5)
            assert abs(drum.drum_speed) <= abs(before)
            assert drum.drum_speed * before >= 0.0


def test_contact_expires_and_unpaid_work_does_not() -> None:
    drum = Drum()
    soil = milling(drum)
    soil.receive(answer(1e5, 1e7), POSE)
    for _ in range(FORCE_TIMEOUT_TICKS + 1):
        soil.begin_tick()
    assert soil.contact[MAX_FORCE] == 0.0
    assert soil.debt == 1e5
    assert soil.is_active


def test_drum_that_is_not_driven_is_supported() -> None:
    drum = Drum(drum_speed=0.0, commanded_drum_speed=0.0)
    soil = milling(drum)
    rows = answer(0.0, 50e3, direction=(0, 0, 1))[1:]
    soil.receive(rows, POSE)
    sinking = ((0.0, 0.0, -0.2), (0.0, 0.0, 0.0))
    assert soil.step(POSE, sinking, DT)[0][2] > 0.0


@pytest.mark.parametrize("field", ["fx", "x", "work"])
def test_answer_that_is_not_finite_is_rejected(field: str) -> None:
    soil = milling(Drum())
    rows = answer(100.0)
    rows[field] = np.nan
    with pytest.raises(MachineError, match="give"):
        soil.receive(rows, POSE)
    assert soil.debt == 0.0

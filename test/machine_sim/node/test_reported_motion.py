"""Reported velocities of a machine that skips ticks: distance moved over the time that passed."""

from __future__ import annotations

import numpy as np
import pytest
from support.machine_scenes import machine_on_level_ground

from machine_sim.node.reported_motion import ReportedMotion, TickProgress, VelocityScale

TICK = 0.01


def test_velocities_are_exact_if_every_tick_is_made() -> None:
    scale = VelocityScale()
    assert [scale.update(TickProgress(n, n)) for n in (0, 1, 2, 5, 5)] == [1.0] * 5


def test_scale_is_the_fraction_of_ticks_made_since_the_last_publication() -> None:
    scale = VelocityScale()
    progress = [TickProgress(0, 0), TickProgress(1, 4), TickProgress(5, 8), TickProgress(5, 8)]
    assert [scale.update(each) for each in progress] == [1.0, 0.25, 1.0, 1.0]


def test_reported_velocity_is_distance_over_time_if_ticks_are_skipped() -> None:
    sim = machine_on_level_ground()
    machine, scale = sim.machine, VelocityScale()
    reported, angles, times, passed = [], [], [], 0
    try:
        for made in range(200):
            machine.command([0.3, 0.0, 0.0, 0.0], [0.5, 0.5])
            sim.step()
            passed += 1 + made % 4
            if made >= 60:  # the machine moves steadily
                motion = ReportedMotion.of_machine(
                    machine, scale.update(TickProgress(made, passed))
                )
                reported.append(
                    (motion.joint_velocities[0], np.linalg.norm(motion.base_velocity[0]))
                )
                angles.append((motion.joint_positions[0], motion.base_pose[0][:2].copy()))
                times.append(passed * TICK)
    finally:
        sim.close()
    duration = times[-1] - times[0]
    weights = np.diff(times) / duration
    swing, speed = weights @ np.array(reported[1:])
    assert swing == pytest.approx((angles[-1][0] - angles[0][0]) / duration, rel=0.01)
    distance = np.linalg.norm(angles[-1][1] - angles[0][1])
    assert speed == pytest.approx(distance / duration, rel=0.01)

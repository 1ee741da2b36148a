"""Sweeps that no machine can make are rejected, tool by tool."""

from __future__ import annotations

import numpy as np
import pytest
from support.soil_scenes import bucket_sweep

from msg_bridge.contract.rows import Rows, SweepAction
from soil_sim.sweep_limits import SweepLimits

STEP = 0.05  # m in a tick


@pytest.fixture
def limits() -> SweepLimits:
    limits = SweepLimits(0.2)
    limits.update_sessions({1: 5})
    return limits


def sweep(x: float, *, to: float | None = None, y: float = 0.0, tool: int = 0) -> Rows:
    """Return the sweep of a bucket from x to `to` [m], by default one step further."""
    rows = bucket_sweep((x, y, 0.0), (x + STEP if to is None else to, y, 0.0)).copy()
    rows["machine_id"], rows["tool"] = 1, tool
    return rows


def is_accepted(limits: SweepLimits, tick: int, rows: Rows) -> bool:
    accepted, messages = limits.check(tick, rows)
    assert accepted.size in (0, rows.size)
    assert bool(messages) is (accepted.size == 0)
    return accepted.size > 0


def test_continuous_motion_is_accepted(limits: SweepLimits) -> None:
    for tick in range(1, 10):
        assert is_accepted(limits, tick, sweep(STEP * tick))


def test_sweep_from_another_place_is_rejected_and_the_next_of_the_tool_accepted(
    limits: SweepLimits,
) -> None:
    assert is_accepted(limits, 1, sweep(0.0))
    assert not is_accepted(limits, 2, sweep(3.0))
    assert is_accepted(limits, 3, sweep(STEP))


def test_sweep_above_the_maximum_speed_is_rejected(limits: SweepLimits) -> None:
    assert is_accepted(limits, 1, sweep(0.0, to=0.19))
    assert not is_accepted(limits, 2, sweep(0.19, to=0.4))


def test_tool_that_changes_its_shape_is_rejected(limits: SweepLimits) -> None:
    assert is_accepted(limits, 1, sweep(0.0))
    rows = sweep(STEP)
    rows["y1"] *= 1.2  # within the maximum displacement of each point
    assert not is_accepted(limits, 2, rows)
    fewer = [is_accepted(limits, 3 + k, sweep(STEP * k)[2:]) for k in range(30)]
    assert fewer == [False] * 20 + [True] * 10


def test_tools_of_machines_that_share_a_node_may_be_far_apart(limits: SweepLimits) -> None:
    for tick in range(1, 4):
        both = np.concatenate([sweep(STEP * tick), sweep(80.0 + STEP * tick, tool=4)])
        assert is_accepted(limits, tick, both)


def test_sole_that_lifts_is_accepted(limits: SweepLimits) -> None:
    rows = [sweep(0.0), sweep(STEP)]
    for each in rows:
        each["action"] = SweepAction.COMPACT
    rows[1]["z0"] += 0.08
    rows[1]["z1"] += 0.08
    assert is_accepted(limits, 1, rows[0])
    assert is_accepted(limits, 2, rows[1])


def test_track_that_rests_for_some_ticks_may_have_crept(limits: SweepLimits) -> None:
    assert is_accepted(limits, 1, sweep(0.0))
    assert is_accepted(limits, 11, sweep(0.5))


def test_one_rejected_tool_does_not_affect_the_others(limits: SweepLimits) -> None:
    first = np.concatenate([sweep(0.0), sweep(1.0, tool=1)])
    assert limits.check(1, first)[0].size == first.size
    accepted, messages = limits.check(2, np.concatenate([sweep(STEP), sweep(9.0, tool=1)]))
    assert accepted["tool"].tolist() == [0] * accepted.size
    assert len(messages) == 1


def test_machine_that_was_moved_is_accepted_after_continuous_motion(limits: SweepLimits) -> None:
    assert is_accepted(limits, 1, sweep(0.0))
    accepted = [is_accepted(limits, 2 + k, sweep(20.0 + STEP * k)) for k in range(30)]
    assert accepted == [False] * 20 + [True] * 10


def test_machine_in_another_session_may_begin_anywhere(limits: SweepLimits) -> None:
    assert is_accepted(limits, 1, sweep(0.0))
    limits.update_sessions({1: 6})
    assert is_accepted(limits, 2, sweep(20.0))


def test_coordinates_that_are_not_finite_are_left_to_the_soil(limits: SweepLimits) -> None:
    rows = sweep(0.0)
    rows["z1"] = np.nan
    assert is_accepted(limits, 1, rows)

"""Validation of tool sweeps, and their split into pairs that cut and that compact."""

from collections.abc import Callable

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    bucket_sweep,
    flat_soil,
    make_deposit_requests,
    tool_sweep,
)

from msg_bridge.contract.rows import MAX_PRESSURE, Rows, SweepAction
from soil_sim.errors import SoilError
from soil_sim.soils.params import SoilParams
from soil_sim.sweep_validation import validate_sweeps
from soil_sim.tool_sweeps import group_by_machine, pressed_pairs

MODES = SoilParams.__dataclass_fields__["cut_mode"].metadata["choices"]
COORDINATES = ("x0", "y0", "z0", "x1", "y1", "z1")


def two_machines(change: Callable[[Rows], Rows]) -> Rows:
    """Return a valid tool of machine 1 and, 3 m beside it, tool 4 of machine 2 after a change."""
    valid, other = dig(0.0), dig(3.0)
    other["machine_id"], other["tool"] = 2, 4
    return np.concatenate([valid, change(other)])


def dig(y: float) -> Rows:
    """Return the sweep of a bucket that enters the soil."""
    return bucket_sweep((0.01, y, 0.1), (0.05, y, -0.2))


def setting(field: str, value: float, row: int = 3) -> Callable[[Rows], Rows]:
    """Return a change of one field of one row."""

    def change(rows: Rows) -> Rows:
        rows[field][row] = value
        return rows

    return change


def pressing(pressure: float) -> Callable[[Rows], Rows]:
    """Return a change to a pair that compacts under a pressure [Pa]."""

    def change(rows: Rows) -> Rows:
        rows["action"][2:4], rows["pressure"][3] = SweepAction.COMPACT, pressure
        return rows

    return change


INVALID = {
    **{
        f"{name} {value}": setting(name, value)
        for name in COORDINATES
        for value in (np.nan, -np.inf)
    },
    **{f"{name} {value}": setting(name, value) for name in COORDINATES for value in (2e5, -1e18)},
    "jump": setting("x1", 30.0),
    "sweeps too much": lambda rows: large(rows),
    "too wide": lambda rows: wide(rows),
    "first row missing": lambda rows: rows[1:],
    "last row missing": lambda rows: rows[:-1],
    "pair missing": lambda rows: np.delete(rows, [4, 5]),
    "pair duplicated": lambda rows: np.concatenate([rows, rows[-2:]]),
    "all rows duplicated": lambda rows: np.concatenate([rows, rows]),
    "pairs out of order": lambda rows: rows[np.roll(np.arange(rows.size), 2)],
    "left ends before right ends": lambda rows: np.concatenate([rows[::2], rows[1::2]]),
    "two actions in a pair": setting("action", SweepAction.COMPACT),
    "two rooms": setting("room_mm3", 5),
    "mills with one pair only": setting("action", SweepAction.MILL, row=slice(2, 4)),  # type: ignore[arg-type]
    "work of a tool that does not mill": setting("work", 1.0, row=slice(None)),  # type: ignore[arg-type]
    "pressure of a pair that cuts": setting("pressure", 1.0),
    **{
        f"pressure {value}": pressing(value) for value in (np.nan, np.inf, -1.0, 1.1 * MAX_PRESSURE)
    },
    "unknown action": setting("action", 9, row=slice(2, 4)),  # type: ignore[arg-type]
}


def large(rows: Rows) -> Rows:
    """Return the sweep of a bucket 24 m wide that moves 10 m."""
    for end in "01":
        rows[f"y{end}"] = np.where(np.arange(rows.size) % 2, 3.0, 27.0)
    rows["x1"] += 10.0
    return rows


def wide(rows: Rows) -> Rows:
    rows["y0"][::2] = rows["y1"][::2] = 90.0
    return rows


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("case", INVALID)
def test_invalid_tool_is_rejected_and_does_not_affect_others(case: str, mode: str) -> None:
    soil, alone = flat_soil(10.0, 0.2, cut_mode=mode), flat_soil(10.0, 0.2, cut_mode=mode)
    step = soil.step(0, two_machines(INVALID[case]), NO_DEPOSIT_REQUESTS)
    expected = alone.step(0, dig(0.0), NO_DEPOSIT_REQUESTS)
    assert expected.conversions.size > 5
    assert np.array_equal(step.conversions, expected.conversions)
    assert set(step.forces["machine_id"]) == {1}
    assert soil.state_hash() == alone.state_hash()
    assert len(step.rejected_tools) == 1
    assert "machine 2, tool 4" in step.rejected_tools[0]
    assert expected.rejected_tools == ()


@pytest.mark.parametrize(
    ("case", "advice"),
    [
        ("x1 nan", "not finite"),
        ("jump", "20 m"),
        ("too wide", "50 m"),
        ("sweeps too much", "50 m2"),
        ("pair missing", "all its pairs"),
        ("two actions in a pair", "action"),
        ("two rooms", "room_mm3"),
        ("pressure of a pair that cuts", "pressure"),
    ],
)
def test_message_of_a_rejected_tool_names_what_to_change(case: str, advice: str) -> None:
    step = flat_soil(10.0, 0.2).step(0, two_machines(INVALID[case]), NO_DEPOSIT_REQUESTS)
    assert advice in step.rejected_tools[0]


def test_all_rows_of_an_invalid_tool_are_rejected_and_no_others() -> None:
    good, bad = dig(0.0), dig(3.0)
    bad["tool"] = 1
    bad["z1"][0] = np.nan
    soil = flat_soil(10.0, 0.2)
    step = soil.step(0, np.concatenate([bad, good]), NO_DEPOSIT_REQUESTS)
    assert set(step.forces["tool"]) == {0}
    assert (np.abs(step.conversions["y"]) < 1.0).all()


def test_no_pair_is_formed_across_tools() -> None:
    # Two tools of one row each, 4 m apart: as one pair they would cut a trench between them.
    rows = tool_sweep([(0.0, 0.0)], (0, 0, -0.3), (0.1, 0, -0.3), width=4.0)
    rows["tool"] = [1, 2]
    step = flat_soil(10.0, 0.2).step(0, rows, NO_DEPOSIT_REQUESTS)
    assert step.conversions.size == 0
    assert len(step.rejected_tools) == 2


def test_rows_of_tools_may_be_interleaved() -> None:
    a, b = dig(0.0), dig(3.0)
    b["tool"] = 1
    mixed = np.stack([a, b], axis=1).reshape(-1)
    soils = flat_soil(10.0, 0.2), flat_soil(10.0, 0.2)
    for soil, rows in zip(soils, (mixed, np.concatenate([a, b])), strict=True):
        assert soil.step(0, rows, NO_DEPOSIT_REQUESTS).rejected_tools == ()
    assert soils[0].state_hash() == soils[1].state_hash()


@pytest.mark.parametrize("mode", MODES)
def test_tool_beyond_the_map_is_valid_and_cuts_nothing(mode: str) -> None:
    soil = flat_soil(10.0, 0.2, cut_mode=mode)
    far = bucket_sweep((9e4, -9e4, -0.1), (9e4, -9e4, -0.2))
    step = soil.step(0, far, NO_DEPOSIT_REQUESTS)
    assert step.rejected_tools == ()
    assert step.forces.size == 1
    assert step.map_updates.size == 0


@pytest.mark.parametrize(
    ("tick", "sweeps", "deposit_requests"),
    [
        (2**32, dig(0.0), NO_DEPOSIT_REQUESTS),
        (-1, dig(0.0), NO_DEPOSIT_REQUESTS),
        (0, dig(0.0), dig(0.0)),
        (0, NO_DEPOSIT_REQUESTS, make_deposit_requests(0.0, 0.0, 1000)),
    ],
)
def test_step_that_raises_changes_nothing(tick: int, sweeps: Rows, deposit_requests: Rows) -> None:
    soil = flat_soil(10.0, 0.2)
    before = soil.state_hash()
    with pytest.raises(SoilError):
        soil.step(tick, sweeps, deposit_requests)
    assert soil.state_hash() == before
    assert soil.columns.total_mm3 == soil.total_mm3
    assert soil.relaxation.num_pending == 0


# Grouping


def tool(machine_id: int, number: int, actions: list[SweepAction], x: float = 0.0) -> Rows:
    """Return a tool with a pair for each of the actions."""
    profile = [(-0.1 * k, 0.1 * k) for k in range(len(actions))]
    rows = tool_sweep(profile, (x, 0.0, 0.5), (x + 0.125, 0.0, 0.5), width=2.0)
    rows["machine_id"], rows["tool"] = machine_id, number
    rows["action"] = np.repeat(actions, 2)
    return rows


def test_pair_has_start_and_end_of_its_left_and_right_end() -> None:
    rows = bucket_sweep((0.0, 0.5, 0.25), (0.125, 0.5, 0.0), width=1.0)
    (machine,) = group_by_machine(validate_sweeps(rows)[0])
    assert machine.machine_id == 1
    assert np.array_equal(machine.rows, rows)
    (cut,) = machine.cuts
    pairs = cut.pairs
    assert pairs.points[0].tolist() == [
        [[0.0, 1.0, 0.25], [0.0, 0.0, 0.25]],
        [[0.125, 1.0, 0.0], [0.125, 0.0, 0.0]],
    ]
    assert pairs.has_plate.tolist() == [True] * 6 + [False]
    assert pressed_pairs(machine.rows, machine.points)[0].size == 0


def test_plates_span_successive_pairs_of_one_tool_with_the_same_action() -> None:
    cut, press, mill = SweepAction.CUT, SweepAction.COMPACT, SweepAction.MILL
    rows = np.concatenate(
        [tool(3, 0, [cut, cut, press, press, cut]), tool(3, 1, [mill, mill]), tool(3, 2, [press])]
    )
    (machine,) = group_by_machine(validate_sweeps(rows)[0])
    first, second = machine.cuts
    assert first.pairs.has_plate.tolist() == [True, False, False]
    assert second.pairs.has_plate.tolist() == [True, False]
    assert (first.tool, first.work, second.tool, second.work) == (0, None, 1, 0.0)
    _, has_plate, _, tools = pressed_pairs(machine.rows, machine.points)
    assert has_plate.tolist() == [True, False, False]
    assert tools.tolist() == [0, 0, 2]


def test_sweeps_are_grouped_by_machine_in_order() -> None:
    press = [SweepAction.COMPACT] * 2
    rows = np.concatenate([tool(7, 0, press, x=1.0), tool(2, 0, press), tool(2, 1, press, x=2.0)])
    rows["pressure"] = 1e3 * np.arange(12)
    machines = group_by_machine(validate_sweeps(rows)[0])
    assert [machine.machine_id for machine in machines] == [2, 7]
    assert [machine.rows.size for machine in machines] == [8, 4]
    points, _, pressure, tools = pressed_pairs(machines[0].rows, machines[0].points)
    assert points[:, 0, 0, 0].round(3).tolist() == [0.0, -0.1, 2.0, 1.9]
    assert pressure.tolist() == [[4e3, 5e3], [6e3, 7e3], [8e3, 9e3], [1e4, 11e3]]
    assert tools.tolist() == [0, 0, 1, 1]
    points, *_ = pressed_pairs(machines[1].rows, machines[1].points)
    assert points[:, 0, 0, 0].round(3).tolist() == [1.0, 0.9]


def test_no_sweeps_are_no_machines() -> None:
    sweeps, rejected = validate_sweeps(bucket_sweep((0, 0, 0), (0, 0, 0))[:0])
    assert (sweeps.first_row.size, rejected) == (0, ())
    assert group_by_machine(sweeps) == []

"""What each source's tools do in a tick, as pairs that cut and pairs that press."""

import numpy as np
from support.soil_scenes import bucket_sweep, tool_sweep

from msg_bridge.contract.rows import Rows, SweepAction
from soil_sim.tool_sweeps import group_by_machine, validate_sweeps


def tool(machine_id: int, number: int, actions: list[SweepAction], x: float = 0.0) -> Rows:
    """A tool with a pair for each of the actions."""
    profile = [(-0.1 * k, 0.1 * k) for k in range(len(actions))]
    rows = tool_sweep(profile, (x, 0.0, 0.5), (x + 0.125, 0.0, 0.5), width=2.0)
    rows["machine_id"], rows["tool"] = machine_id, number
    rows["action"] = np.repeat(actions, 2)
    return rows


def test_a_pair_is_start_and_end_of_its_left_and_right_end() -> None:
    rows = bucket_sweep((0.0, 0.5, 0.25), (0.125, 0.5, 0.0), width=1.0)
    (stroke,) = group_by_machine(validate_sweeps(rows)[0])
    assert stroke.machine_id == 1
    assert np.array_equal(stroke.rows, rows)
    assert stroke.cut_pairs.points[0].tolist() == [
        [[0.0, 1.0, 0.25], [0.0, 0.0, 0.25]],
        [[0.125, 1.0, 0.0], [0.125, 0.0, 0.0]],
    ]
    assert stroke.cut_pairs.has_plate.tolist() == [True] * 6 + [False]
    assert stroke.press_pairs.has_plate.size == 0


def test_plates_span_neighbouring_pairs_of_one_tool_that_do_the_same() -> None:
    cut, press, mill = SweepAction.CUT, SweepAction.COMPACT, SweepAction.MILL
    rows = np.concatenate(
        [tool(3, 0, [cut, cut, press, press, cut]), tool(3, 1, [mill, mill]), tool(3, 2, [press])]
    )
    (stroke,) = group_by_machine(validate_sweeps(rows)[0])
    assert stroke.cut_pairs.has_plate.tolist() == [True, False, False, True, False]
    assert stroke.press_pairs.has_plate.tolist() == [True, False, False]


def test_sources_come_apart_and_in_order() -> None:
    press = [SweepAction.COMPACT] * 2
    rows = np.concatenate([tool(7, 0, press, x=1.0), tool(2, 0, press), tool(2, 1, press, x=2.0)])
    strokes = group_by_machine(validate_sweeps(rows)[0])
    assert [stroke.machine_id for stroke in strokes] == [2, 7]
    assert [stroke.rows.size for stroke in strokes] == [8, 4]
    assert strokes[0].press_pairs.points[:, 0, 0, 0].round(3).tolist() == [0.0, -0.1, 2.0, 1.9]
    assert strokes[1].press_pairs.points[:, 0, 0, 0].round(3).tolist() == [1.0, 0.9]


def test_no_sweeps_are_no_strokes() -> None:
    sweeps, refused = validate_sweeps(bucket_sweep((0, 0, 0), (0, 0, 0))[:0])
    assert (sweeps.first_row.size, refused) == (0, ())
    assert group_by_machine(sweeps) == []

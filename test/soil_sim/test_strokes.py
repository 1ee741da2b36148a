"""What each source's tools do in a tick, as pairs that cut and pairs that press."""

import numpy as np
from support.soil_scenes import bucket_sweep, tool_sweep

from msg_bridge.contract.rows import Action, Rows
from soil_sim.sweeps import sound_sweeps, strokes_of


def tool(source: int, number: int, actions: list[Action], x: float = 0.0) -> Rows:
    """A tool with a pair for each of the actions."""
    profile = [(-0.1 * k, 0.1 * k) for k in range(len(actions))]
    rows = tool_sweep(profile, (x, 0.0, 0.5), (x + 0.125, 0.0, 0.5), width=2.0)
    rows["source"], rows["tool"] = source, number
    rows["action"] = np.repeat(actions, 2)
    return rows


def test_a_pair_is_start_and_end_of_its_left_and_right_end() -> None:
    rows = bucket_sweep((0.0, 0.5, 0.25), (0.125, 0.5, 0.0), width=1.0)
    (stroke,) = strokes_of(sound_sweeps(rows)[0])
    assert stroke.source == 1
    assert np.array_equal(stroke.rows, rows)
    assert stroke.cut.points[0].tolist() == [
        [[0.0, 1.0, 0.25], [0.0, 0.0, 0.25]],
        [[0.125, 1.0, 0.0], [0.125, 0.0, 0.0]],
    ]
    assert stroke.cut.joined.tolist() == [True] * 6 + [False]
    assert stroke.press.joined.size == 0


def test_plates_span_neighbouring_pairs_of_one_tool_that_do_the_same() -> None:
    cut, press, mill = Action.CUT, Action.PRESS, Action.MILL
    rows = np.concatenate(
        [tool(3, 0, [cut, cut, press, press, cut]), tool(3, 1, [mill, mill]), tool(3, 2, [press])]
    )
    (stroke,) = strokes_of(sound_sweeps(rows)[0])
    assert stroke.cut.joined.tolist() == [True, False, False, True, False]
    assert stroke.press.joined.tolist() == [True, False, False]


def test_sources_come_apart_and_in_order() -> None:
    press = [Action.PRESS] * 2
    rows = np.concatenate([tool(7, 0, press, x=1.0), tool(2, 0, press), tool(2, 1, press, x=2.0)])
    strokes = strokes_of(sound_sweeps(rows)[0])
    assert [stroke.source for stroke in strokes] == [2, 7]
    assert [stroke.rows.size for stroke in strokes] == [8, 4]
    assert strokes[0].press.points[:, 0, 0, 0].round(3).tolist() == [0.0, -0.1, 2.0, 1.9]
    assert strokes[1].press.points[:, 0, 0, 0].round(3).tolist() == [1.0, 0.9]


def test_no_sweeps_are_no_strokes() -> None:
    sweeps, refused = sound_sweeps(bucket_sweep((0, 0, 0), (0, 0, 0))[:0])
    assert (sweeps.first.size, refused) == (0, ())
    assert strokes_of(sweeps) == []

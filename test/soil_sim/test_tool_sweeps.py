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

from msg_bridge.contract.rows import Rows, SweepAction
from soil_sim.errors import SoilError
from soil_sim.soils.params import SoilParams

MODES = SoilParams.__dataclass_fields__["cut_mode"].metadata["choices"]
COORDINATES = ("x0", "y0", "z0", "x1", "y1", "z1")


def two_machines(change: Callable[[Rows], Rows]) -> Rows:
    """A sound tool of source 1 and, 3 m beside it, tool 4 of source 2 as `change` leaves it."""
    sound, other = dig(0.0), dig(3.0)
    other["machine_id"], other["tool"] = 2, 4
    return np.concatenate([sound, change(other)])


def dig(y: float) -> Rows:
    """A bucket that enters the soil."""
    return bucket_sweep((0.01, y, 0.1), (0.05, y, -0.2))


def setting(field: str, value: float, row: int = 3) -> Callable[[Rows], Rows]:
    """A change of one field of one row."""

    def change(rows: Rows) -> Rows:
        rows[field][row] = value
        return rows

    return change


BAD = {
    **{
        f"{name} {value}": setting(name, value)
        for name in COORDINATES
        for value in (np.nan, -np.inf)
    },
    **{f"{name} {value}": setting(name, value) for name in COORDINATES for value in (2e5, -1e18)},
    "a leap": setting("x1", 30.0),
    "too wide": lambda rows: wide(rows),
    "a row lost": lambda rows: rows[1:],
    "the last row lost": lambda rows: rows[:-1],
    "a pair lost": lambda rows: np.delete(rows, [4, 5]),
    "a pair twice": lambda rows: np.concatenate([rows, rows[-2:]]),
    "all twice": lambda rows: np.concatenate([rows, rows]),
    "pairs out of order": lambda rows: rows[np.roll(np.arange(rows.size), 2)],
    "lefts, then rights": lambda rows: np.concatenate([rows[::2], rows[1::2]]),
    "half pressing": setting("action", SweepAction.COMPACT),
    "no such action": setting("action", 9, row=slice(2, 4)),  # type: ignore[arg-type]
}


def wide(rows: Rows) -> Rows:
    rows["y0"][::2] = rows["y1"][::2] = 90.0
    return rows


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("case", BAD)
def test_a_tool_that_cannot_be_believed_moves_nothing_and_the_others_their_own(
    case: str, mode: str
) -> None:
    soil, alone = flat_soil(10.0, 0.2, cut_mode=mode), flat_soil(10.0, 0.2, cut_mode=mode)
    step = soil.step(0, two_machines(BAD[case]), NO_DEPOSIT_REQUESTS)
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
        ("a leap", "20 m"),
        ("too wide", "50 m"),
        ("a pair lost", "all its pairs"),
        ("half pressing", "action"),
    ],
)
def test_a_refusal_says_what_to_change(case: str, advice: str) -> None:
    refused = (
        flat_soil(10.0, 0.2).step(0, two_machines(BAD[case]), NO_DEPOSIT_REQUESTS).rejected_tools
    )
    assert advice in refused[0]


def test_a_refused_tool_is_refused_whole_and_alone() -> None:
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


def test_rows_of_tools_may_come_in_turns() -> None:
    a, b = dig(0.0), dig(3.0)
    b["tool"] = 1
    mixed = np.stack([a, b], axis=1).reshape(-1)
    soils = flat_soil(10.0, 0.2), flat_soil(10.0, 0.2)
    for soil, rows in zip(soils, (mixed, np.concatenate([a, b])), strict=True):
        assert soil.step(0, rows, NO_DEPOSIT_REQUESTS).rejected_tools == ()
    assert soils[0].state_hash() == soils[1].state_hash()


@pytest.mark.parametrize("mode", MODES)
def test_a_tool_beyond_the_map_is_believed_and_cuts_nothing(mode: str) -> None:
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
def test_a_step_that_raises_has_changed_nothing(
    tick: int, sweeps: Rows, deposit_requests: Rows
) -> None:
    soil = flat_soil(10.0, 0.2)
    before = soil.state_hash()
    with pytest.raises(SoilError, match="32 bits"):
        soil.step(tick, sweeps, deposit_requests)
    assert soil.state_hash() == before
    assert soil.columns.total_mm3 == soil.total_mm3
    assert soil.relaxation.num_pending == 0

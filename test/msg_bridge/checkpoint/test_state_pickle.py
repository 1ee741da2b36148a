"""Arrays that share memory share it again in a loaded state; kernels' tables are made again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.checkpoint.state_pickle import dump_state, load_state
from msg_bridge.kernels import box_table
from msg_bridge.kernels.decorators import kernel


class Table(NamedTuple):
    first: NDArray[np.float64]
    rest: NDArray[np.float64]


@kernel
def add_one(boxed):  # type: ignore[no-untyped-def]
    boxed.table.first[:] += 1.0


def loaded(state):  # type: ignore[no-untyped-def]
    return load_state(dump_state(state))


def test_views_share_memory_again() -> None:
    base = np.arange(24.0).reshape(4, 6)
    state = {"reversed": base[::-1, 1::2], "row": base[2], "column": base[:, 3], "base": base}
    copy = loaded(state)
    for name, array in state.items():
        np.testing.assert_array_equal(copy[name], array)
        assert copy[name].flags["C_CONTIGUOUS"] == array.flags["C_CONTIGUOUS"]
    copy["base"][2, 3] = -1.0
    assert copy["row"][3] == copy["column"][2] == copy["reversed"][1, 1] == -1.0
    assert base[2, 3] == 15.0


def test_part_of_memory_is_enough() -> None:
    part = np.arange(10_000_000, dtype=np.uint8)[5_000_000:5_000_010]
    assert len(dump_state(part)) < 10_000
    np.testing.assert_array_equal(loaded(part), part)


def test_boxed_table_refers_to_the_loaded_arrays() -> None:
    values = np.zeros(5)
    table = Table(values[:2], values[2:])
    values_copy, boxed = loaded((values, box_table(table)))
    add_one(boxed)
    assert values_copy.tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert values.tolist() == [0.0] * 5


def test_alignment_flags_and_types_are_kept() -> None:
    rows = np.zeros(3, dtype=[("a", "<f4"), ("b", "u1")])
    fixed = np.arange(6)[1:]
    fixed.setflags(write=False)
    shown = loaded([rows, rows["a"], fixed, np.zeros((0, 4)), np.array([None, "x"], dtype=object)])
    assert shown[0].dtype == rows.dtype
    shown[0]["a"] = 2.0
    assert shown[1].tolist() == [2.0] * 3
    assert not shown[2].flags.writeable
    assert shown[2].__array_interface__["data"][0] % 64 == fixed.__array_interface__["data"][0] % 64
    assert shown[3].shape == (0, 4)
    assert shown[4].tolist() == [None, "x"]


def test_random_numbers_continue() -> None:
    generator = np.random.default_rng(7)
    generator.random(3)
    copy = loaded(generator)
    np.testing.assert_array_equal(copy.random(5), generator.random(5))

"""Tables of results, and the same results as JSON lines."""

import math

import pytest

from benchmarks.result_table import Column, Measurement, ResultTable

COLUMNS = (Column("falling"), Column("count", "", "d"))


def test_table_has_a_row_of_formatted_values(capsys: pytest.CaptureFixture[str]) -> None:
    table = ResultTable(COLUMNS, as_json=False)
    table.print_header("ms")
    table.print_row("a", [1.23456, 7], remark="<= 5")
    table.print_row("b", [math.nan, None])
    table.print_row("c", [1.0, 2], texts=["1 (+5 %)", None])
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["ms", "falling", "count"]
    assert lines[1:] == [["a", "1.235", "7", "<=", "5"], ["b"], ["c", "1", "(+5", "%)", "2"]]


def test_json_lines_hold_every_value_and_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    table = ResultTable(COLUMNS, as_json=True)
    table.print_note("a note")
    table.print_header()
    table.print_row("a", [0.5, math.nan])
    table.print_row("b", [None, 3], unit="ticks")
    lines = capsys.readouterr().out.splitlines()
    assert [Measurement.from_json(line) for line in lines] == [
        Measurement("a", "falling", "ms", 0.5),
        Measurement("b", "count", "ticks", 3),
    ]

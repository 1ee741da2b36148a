"""Print the results of a benchmark as a table, or as JSON lines that `benchmarks.compare` reads."""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

__all__ = ["Column", "Measurement", "ResultTable", "describe_load", "make_parser"]


class Column(NamedTuple):
    """A column of numbers.

    Attributes:
        name: the heading.
        unit: the unit of its values; empty for a count or a ratio.
        spec: format specification of a value, as of `format`.
    """

    name: str
    unit: str = "ms"
    spec: str = ".3f"


@dataclass(frozen=True)
class Measurement:
    """A measured value, identified by its row and column.

    Attributes:
        row: the name of its row.
        column: the name of its column.
        unit: the unit of the value.
        value: the value.
    """

    row: str
    column: str
    unit: str
    value: float

    @classmethod
    def from_json(cls, line: str) -> Measurement:
        """Return the measurement in a line that `ResultTable` printed as JSON."""
        return cls(**json.loads(line))


class ResultTable:
    """Print rows of numbers under headings, or one line of JSON for each number."""

    def __init__(
        self, columns: Sequence[Column], *, as_json: bool, row_width: int = 28, width: int = 13
    ) -> None:
        """
        Args:
            columns: the columns of numbers.
            as_json: print JSON lines instead of a table, and no notes.
            row_width: width of the column of row names, in characters.
            width: minimum width of each column of numbers, in characters.
        """
        self._columns, self._as_json, self._row_width = columns, as_json, row_width
        self._widths = [max(width, len(column.name) + 2) for column in columns]

    def print_note(self, text: str) -> None:
        """Print a line that is not a measurement."""
        if not self._as_json:
            print(text, flush=True)

    def print_header(self, corner: str = "") -> None:
        """Print the headings, with `corner` above the row names."""
        cells = zip(self._columns, self._widths, strict=True)
        headings = "".join(f"{column.name:>{width}}" for column, width in cells)
        self.print_note(f"{corner:<{self._row_width}}{headings}")

    def print_row(
        self,
        name: str,
        values: Sequence[float | None],
        *,
        texts: Sequence[str | None] = (),
        unit: str | None = None,
        remark: str = "",
    ) -> None:
        """Print a row.

        Args:
            name: the name of the row, unique in the output.
            values: a value for each column; None or nan leaves the cell empty.
            texts: what the table has instead of the formatted values; None for the value.
            unit: the unit of all values of this row, if it is not that of the columns.
            remark: a text to the right of the table.
        """
        cells = list(texts) or [None] * len(values)
        line = f"{name:<{self._row_width}}"
        for column, width, value, text in zip(
            self._columns, self._widths, values, cells, strict=True
        ):
            is_empty = value is None or math.isnan(value)
            if self._as_json and not is_empty:
                used_unit = column.unit if unit is None else unit
                print(
                    json.dumps(
                        {"row": name, "column": column.name, "unit": used_unit, "value": value}
                    ),
                    flush=True,
                )
            cell = "" if is_empty else format(value, column.spec)
            line += f"{cell if text is None else text:>{width}}"
        self.print_note(f"{line}  {remark}".rstrip())


def make_parser(description: str, *, runs: int | None = None) -> argparse.ArgumentParser:
    """Return a parser with `--json`, and `--runs` where a default is given.

    Args:
        description: the docstring of the module; its first line is printed by `--help`.
        runs: default of the number of runs.
    """
    parser = argparse.ArgumentParser(description=description.split("\n", 1)[0])
    parser.add_argument("--json", action="store_true", help="print one JSON line for each value")
    if runs is not None:
        parser.add_argument("--runs", type=int, default=runs, help=f"number of runs ({runs})")
    return parser


def describe_load() -> str:
    """Return the number of cores and the load average before the measurement."""
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before"

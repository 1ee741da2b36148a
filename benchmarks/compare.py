"""Measure two checkouts side by side: run a benchmark in each in turn, and print the ratios.

    python -m benchmarks.compare ../before particle_step_cost --arguments="--counts 1000 --peers"

Runs the benchmark in the other checkout and in this one alternately (A B A B ...), each time in a
process of its own whose working folder and `PYTHONPATH` are the checkout. Prints the medians of
each measurement and the ratio of this one to the other; a star marks ratios that differ from 1 by
more than `--tolerance`. The benchmark must have the option `--json`.
"""

from __future__ import annotations

import argparse
import os
import shlex
import statistics
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.result_table import Column, Measurement, ResultTable, describe_load
from benchmarks.timing import interleave

THIS_CHECKOUT = Path(__file__).resolve().parents[1]

Medians = dict[tuple[str, str, str], float]
"""Median value by row, column and unit."""


class BenchmarkError(Exception):
    """A benchmark failed or printed no measurements."""


def run_benchmark(checkout: Path, name: str, arguments: Sequence[str]) -> list[Measurement]:
    """Run a benchmark of a checkout in a process of its own.

    Args:
        checkout: root folder of the checkout.
        name: module name of the benchmark within `benchmarks`.
        arguments: passed to the benchmark after `--json`.

    Raises:
        BenchmarkError: the process failed or printed no measurements.
    """
    result = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{name}", "--json", *arguments],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        capture_output=True,
        text=True,
        check=False,
    )
    if result.returncode:
        raise BenchmarkError(
            f"benchmarks.{name} in {checkout} ended with exit code {result.returncode}:\n"
            f"{result.stderr[-2000:]}"
        )
    lines = [line for line in result.stdout.splitlines() if line.startswith("{")]
    if not lines:
        raise BenchmarkError(f"benchmarks.{name} in {checkout} printed no measurements")
    return [Measurement.from_json(line) for line in lines]


def medians_of(runs: Sequence[Sequence[Measurement]]) -> Medians:
    """Return the median over the runs of each measurement."""
    values: dict[tuple[str, str, str], list[float]] = {}
    for run in runs:
        for each in run:
            values.setdefault((each.row, each.column, each.unit), []).append(each.value)
    return {key: statistics.median(found) for key, found in values.items()}


def compare_checkouts(
    other: Path, this: Path, name: str, runs: int, arguments: Sequence[str]
) -> tuple[Medians, Medians]:
    """Run a benchmark in two checkouts alternately.

    Returns:
        The medians of the other checkout and of this one.
    """
    cases = [partial(run_benchmark, checkout, name, arguments) for checkout in (other, this)]
    other_runs, this_runs = zip(*interleave(cases, runs), strict=True)
    return medians_of(other_runs), medians_of(this_runs)


def print_comparison(other: Medians, this: Medians, tolerance: float) -> None:
    """Print both medians and their ratio for each measurement that both checkouts have."""
    columns = [Column("other", "", ".4g"), Column("this", "", ".4g"), Column("this/other", "")]
    table = ResultTable(columns, as_json=False, row_width=60)
    table.print_header()
    for (row, column, unit), before in other.items():
        after = this.get((row, column, unit))
        label = f"{row}, {column}" + (f" [{unit}]" if unit else "")
        if after is None:
            table.print_row(label, [before, None, None], remark="not measured here")
            continue
        ratio = after / before if before else None
        is_different = ratio is not None and abs(ratio - 1.0) > tolerance
        table.print_row(label, [before, after, ratio], remark="*" if is_different else "")


def main() -> None:
    """Measure both checkouts and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("other", type=Path, help="root folder of the other checkout")
    parser.add_argument("benchmark", help="module of the benchmark, such as soil_step_cost")
    parser.add_argument("--runs", type=int, default=3, help="runs in each checkout (3)")
    parser.add_argument(
        "--tolerance", type=float, default=0.03, help="deviation of a ratio without a star (0.03)"
    )
    parser.add_argument(
        "--arguments", type=shlex.split, default=[], help="arguments of the benchmark, one string"
    )
    options = parser.parse_args()
    print(f"{describe_load()}; medians of {options.runs} alternating runs", flush=True)
    try:
        medians = compare_checkouts(
            options.other.resolve(),
            THIS_CHECKOUT,
            options.benchmark,
            options.runs,
            options.arguments,
        )
    except BenchmarkError as error:
        raise SystemExit(str(error)) from error
    print_comparison(*medians, options.tolerance)


if __name__ == "__main__":
    main()

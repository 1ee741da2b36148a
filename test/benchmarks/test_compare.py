"""Two checkouts are measured in turn, and their medians compared."""

import sys
from pathlib import Path

import pytest

from benchmarks import compare
from benchmarks.compare import BenchmarkError, compare_checkouts, run_benchmark

BENCHMARK = """\
import sys
from pathlib import Path
log = Path({log!r})
runs = log.read_text().count({label!r}) if log.exists() else 0
with log.open("a") as stream:
    stream.write({label!r} + "\\n")
assert sys.argv[1:] == ["--json", "--counts", "5"]
print("a note")
value = {values}[runs]
print('{{"row": "5 particles", "column": "settled", "unit": "ms", "value": %s}}' % value)
"""


def make_checkout(root: Path, label: str, values: list[float], log: Path) -> Path:
    """Return a checkout whose benchmark `fake` logs its label and measures the given values."""
    folder = root / label / "benchmarks"
    folder.mkdir(parents=True)
    folder.joinpath("__init__.py").touch()
    source = BENCHMARK.format(log=str(log), label=label, values=values)
    folder.joinpath("fake.py").write_text(source, encoding="utf-8")
    return root / label


def test_checkouts_run_alternately_and_their_medians_are_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log"
    before = make_checkout(tmp_path, "before", [2.0, 9.0, 1.0], log)
    after = make_checkout(tmp_path, "after", [3.0, 2.5, 0.5], log)
    monkeypatch.setattr(compare, "THIS_CHECKOUT", after)
    arguments = [str(before), "fake", "--runs", "3", "--arguments=--counts 5"]
    monkeypatch.setattr(sys, "argv", ["compare", *arguments])
    compare.main()
    assert log.read_text().split() == ["before", "after"] * 3
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.split() == ["5", "particles,", "settled", "[ms]", "2", "2.5", "1.250", "*"]


def test_measurements_are_matched_by_row_column_and_unit(tmp_path: Path) -> None:
    before = make_checkout(tmp_path, "before", [2.0], tmp_path / "log")
    after = make_checkout(tmp_path, "after", [3.0], tmp_path / "log")
    medians = compare_checkouts(before, after, "fake", 1, ["--counts", "5"])
    key = ("5 particles", "settled", "ms")
    assert medians == ({key: 2.0}, {key: 3.0})


def test_failed_benchmark_is_an_error(tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path, "before", [2.0], tmp_path / "log")
    with pytest.raises(BenchmarkError):
        run_benchmark(checkout, "fake", ["--unknown"])

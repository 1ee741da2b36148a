"""Measure whether other programs delay the ticks of a simulation in real time.

    python -m benchmarks.disturbed_real_time
    python -m benchmarks.disturbed_real_time --kinds slow_disk command_flood --runs 5

An excavator digs (`real_time_load`), for some seconds undisturbed and then disturbed: by a
subscriber that takes 0.5 s for each message, a recorder whose disk takes 2 s for each write, a
viewer that is suspended, 10,000 commands a second, or nothing. Each run begins again. A tick is
late as in `real_time_load`.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks import disturbances
from benchmarks.real_time_load import START_TIMEOUT, DiggingNodes
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from earthmoving_sim.multi_process.node_process import NodeProcess

COLUMNS = (
    Column("late undisturbed", "%", ".1f"),
    Column("late disturbed", "%", ".1f"),
    Column("factor undisturbed", "", ".2f"),
    Column("factor disturbed", "", ".2f"),
)
KINDS = ("none", "slow_subscriber", "slow_disk", "suspended_viewer", "command_flood")
START_TIME = 5.0
"""Wall time for which a program may start before its disturbance is measured [s]."""
MAX_SUSPENDED_TIME = 9.0
"""Below the lease of a DDS participant (10 s), after which it counts as gone."""
MACHINE = "/excavator_1"


class Disturbed(NamedTuple):
    """Late ticks [%] and real-time factor without and with a disturbance."""

    late_before: float
    late_during: float
    factor_before: float
    factor_during: float


def main() -> None:
    """Measure and print a row for each disturbance."""
    parser = make_parser(__doc__, runs=3)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument(
        "--seconds", type=float, default=8.0, help="wall time of each measurement, at most 9 (8)"
    )
    options: argparse.Namespace = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    table.print_header("disturbance")
    for kind in options.kinds:
        results = [measure(kind, options.seconds) for _ in range(options.runs)]
        medians = [statistics.median(values) for values in zip(*results, strict=True)]
        late = ", ".join(f"{each.late_before:.1f}/{each.late_during:.1f}" for each in results)
        table.print_row(kind.replace("_", " "), medians, remark=f"late: {late}")


def measure(kind: str, seconds: float) -> Disturbed:
    """Run an excavator that digs, and disturb it.

    Args:
        kind: one of KINDS.
        seconds: wall time of each measurement [s].
    """
    seconds = min(seconds, MAX_SUSPENDED_TIME)
    with tempfile.TemporaryDirectory() as folder:
        run = DiggingNodes(Path(folder), 1)
        process: NodeProcess | None = None
        try:
            run.spin_until(lambda: run.sim_time > 2.0, START_TIMEOUT)
            late_before, factor_before = _sample(run, seconds)
            process = _start(kind, Path(folder), seconds)
            _spin(run, START_TIME)
            if kind == "suspended_viewer" and process is not None:
                process.interrupt(signal.SIGSTOP)
            late_during, factor_during = _sample(run, seconds)
            if process is not None:
                process.check()
        finally:
            if process is not None:
                process.kill()
            run.stop()
    return Disturbed(late_before, late_during, factor_before, factor_during)


def _start(kind: str, folder: Path, seconds: float) -> NodeProcess | None:
    log = folder / f"{kind}.log"
    if kind == "none":
        return None
    if kind == "suspended_viewer":
        arguments = ["--ros-args", "-p", "port:=0", "-p", f"bag_folder:={folder}"]
        return NodeProcess("viewer", "viewer.node", arguments, log)
    arguments = {
        "slow_subscriber": [],
        "command_flood": [MACHINE],
        "slow_disk": [str(folder / "bag"), str(START_TIME + seconds)],
    }[kind]
    return NodeProcess(kind, disturbances.MODULE, [kind, *arguments], log)


def _sample(run: DiggingNodes, seconds: float) -> tuple[float, float]:
    """Return late ticks [%] and the real-time factor of some seconds of wall time."""
    before = run.sample()
    _spin(run, seconds)
    after = run.sample()
    late = 100.0 * (after.num_late - before.num_late) / max(after.tick - before.tick, 1)
    return late, (after.sim_time - before.sim_time) / (after.wall - before.wall)


def _spin(run: DiggingNodes, seconds: float) -> None:
    end = time.monotonic() + seconds
    run.spin_until(lambda: time.monotonic() > end, seconds + 30.0)


if __name__ == "__main__":
    main()

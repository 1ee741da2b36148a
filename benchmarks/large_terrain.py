"""Measure what maps of a large terrain cost in real time, over DDS: the largest delay of a tick.

    python -m benchmarks.large_terrain --num-points 2049

One machine stands and turns a little now and then, so that its tracks change the terrain; it does
not dig, so that it needs few of the ticks' time. After some seconds, programs that show or
record the terrain come and go: each receives all of it.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import PointCloud2

from benchmarks.real_time_load import START_TIMEOUT, DiggingNodes, DigScript
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from msg_bridge.codec import qos
from msg_bridge.contract import topics

COLUMNS = (
    Column("max delay", "ms", ".1f"),
    Column("late ticks", "%", ".1f"),
    Column("real-time factor", "", ".2f"),
    Column("received", "MB/s", ".0f"),
)
OBSERVER_TIME = 5.0
"""Wall time for which an observer is subscribed [s]."""
DRIVE_PERIOD = 4.0
"""Simulation time between two turns [s]."""


class PhaseResult(NamedTuple):
    """Result of one phase.

    Attributes:
        max_delay: largest time by which a tick began late [ms].
        late_percent: late ticks of all ticks [%].
        real_time_factor: simulation time over wall time.
        received_rate: terrain that observers received [MB/s].
    """

    max_delay: float
    late_percent: float
    real_time_factor: float
    received_rate: float


class TurnScript(DigScript):
    """The arm at rest; the machine turns a little to and fro."""

    def goal(self, sim_time: float) -> np.ndarray:
        """Return the angles of swing, boom, arm and bucket [rad], shape (4,)."""
        return super().goal(0.0)

    def track_speeds(self, sim_time: float) -> list[float]:
        """Return the speeds of the left and the right track [m/s]."""
        cycle, phase = divmod(sim_time, DRIVE_PERIOD)
        speed = 0.1 if phase < 1.0 else 0.0
        return [speed, -speed] if int(cycle) % 2 else [-speed, speed]


def main() -> None:
    """Measure and print a row without and one with observers."""
    parser = make_parser(__doc__, runs=3)
    parser.add_argument("--num-points", type=int, default=2049, help="rows and columns (2049)")
    parser.add_argument("--seconds", type=float, default=20.0, help="wall time of a phase (20)")
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    table.print_header("observers")
    runs = [run_phases(options.num_points, options.seconds) for _ in range(options.runs)]
    for name, results in zip(("none", "come and go"), zip(*runs, strict=True), strict=True):
        medians = [statistics.median(values) for values in zip(*results, strict=True)]
        delays = ", ".join(f"{result.max_delay:.0f}" for result in results)
        table.print_row(name, medians, remark=f"max delay: {delays}")


def run_phases(num_points: int, seconds: float) -> tuple[PhaseResult, PhaseResult]:
    """Run a soil node and a machine node; return the results without and with observers.

    Args:
        num_points: rows and columns of the terrain.
        seconds: wall time of each phase [s].
    """
    site = {"terrain": "flat", "num_points": num_points, "cell": 0.2}
    with tempfile.TemporaryDirectory() as folder:
        run = DiggingNodes(Path(folder), 1, TurnScript, site=site)
        try:
            run.spin_until(lambda: run.sim_time > 5.0, START_TIMEOUT)
            return _measure(run, seconds, observes=False), _measure(run, seconds, observes=True)
        finally:
            run.stop()


def _measure(run: DiggingNodes, seconds: float, *, observes: bool) -> PhaseResult:
    received = 0

    def receive(data: bytes) -> None:
        nonlocal received
        received += len(data)

    before = run.sample()
    run.max_delay = 0.0
    while time.monotonic() - before.wall < seconds:
        end = time.monotonic() + OBSERVER_TIME
        subscriptions = [
            run.node.create_subscription(PointCloud2, f"/{name}", receive, profile, raw=True)
            for name, profile in (
                (topics.TERRAIN_MAP, qos.TRANSIENT_LOCAL),
                (topics.TERRAIN_TILES, qos.TILES),
            )
            if observes
        ]
        run.spin_until(lambda end=end: time.monotonic() > end, OBSERVER_TIME + 30.0)
        for each in subscriptions:
            run.node.destroy_subscription(each)
    after = run.sample()
    wall = after.wall - before.wall
    return PhaseResult(
        run.max_delay,
        100.0 * (after.num_late - before.num_late) / max(after.tick - before.tick, 1),
        (after.sim_time - before.sim_time) / wall,
        1e-6 * received / wall,
    )


if __name__ == "__main__":
    main()

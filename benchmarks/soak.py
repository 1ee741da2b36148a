"""Let a machine dig over DDS in real time for a long time, and watch memory, late ticks and volume.

    python -m benchmarks.soak --minutes 60

Every minute a row is printed. The exit code is 1 if a volume is out of balance, if the memory of a
node at the end is more than 2 % above that after a sixth of the time, or if the soil node made
fewer ticks than the clock asks for and does not report them as late or as lost time.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from benchmarks.real_time_load import CYCLE_TIME, START_TIMEOUT, DiggingNodes, DigScript
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser

COLUMNS = (
    Column("simulation time", "s", ".0f"),
    Column("soil memory", "MB", ".1f"),
    Column("machine memory", "MB", ".1f"),
    Column("late ticks", "%", ".2f"),
    Column("lost time", "s", ".2f"),
    Column("particles", "", ".0f"),
    Column("imbalance", "mm3", ".0f"),
)

MAX_GROWTH = 0.02
"""Maximum growth of the memory of a node from a sixth of the time on."""

SWING_STEP, MAX_SWING = 0.12, 2.4
"""Angle between the trenches of successive cycles, and the largest one [rad]."""


class State(NamedTuple):
    """State of the nodes at one time; memory is resident memory [MB]."""

    sim_time: float
    soil_memory: float
    machine_memory: float
    late_percent: float
    lost_time: float
    particles: float
    imbalance: float


class TurningDigScript(DigScript):
    """The dig cycle, in another direction each time, so that there is soil to dig."""

    def goal(self, sim_time: float) -> np.ndarray:
        """Return the angles of swing, boom, arm and bucket [rad], shape (4,)."""
        angles = super().goal(sim_time)
        turn = (sim_time // CYCLE_TIME * SWING_STEP) % (4.0 * MAX_SWING)
        angles[0] += abs(turn - 2.0 * MAX_SWING) - MAX_SWING
        return angles


class WatchedNodes(DiggingNodes):
    """Digging nodes whose imbalance and lost time are kept."""

    def state(self) -> State:
        """Return the state at the next diagnostics."""
        sample = self.sample()
        (machine,) = self.machines
        return State(
            sample.sim_time,
            resident_memory(self.soil.pid),
            resident_memory(machine.pid),
            100.0 * sample.num_late / max(sample.tick, 1.0),
            self._values["lost_time_s"],
            sample.particles,
            self._values["imbalance_mm3"],
        )

    def _store(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            values = {pair.key: pair.value for pair in status.values}
            for key in ("imbalance_mm3", "lost_time_s"):
                if key in values:
                    self._values[key] = float(values[key])
        super()._store(msg)


def main() -> int:
    """Run, print a row a minute, and return the exit code."""
    parser = make_parser(__doc__, runs=1)
    parser.add_argument("--minutes", type=float, default=60.0, help="wall time (60)")
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(describe_load())
    table.print_header("minute")
    states: list[State] = []
    with tempfile.TemporaryDirectory() as folder:
        run = WatchedNodes(Path(folder), 1, TurningDigScript)
        try:
            run.spin_until(lambda: run.sim_time > 2.0, START_TIMEOUT)
            start = time.monotonic()
            begin = run.state()
            while time.monotonic() - start < 60.0 * options.minutes:
                end = time.monotonic() + 60.0
                run.spin_until(lambda end=end: time.monotonic() > end, 90.0)
                states.append(run.state())
                table.print_row(str(len(states)), states[-1])
            elapsed = time.monotonic() - start
        finally:
            run.stop()
    problems = find_problems(begin, states, elapsed)
    for problem in problems:
        print(f"soak: {problem}", file=sys.stderr)
    return bool(problems)


def find_problems(begin: State, states: list[State], elapsed: float) -> list[str]:
    """Return what is wrong with a run.

    Args:
        begin: state at the start.
        states: state after each minute.
        elapsed: wall time [s].
    """
    problems = []
    early, last = states[len(states) // 6], states[-1]
    for name in ("soil_memory", "machine_memory"):
        growth = getattr(last, name) / getattr(early, name) - 1.0
        if growth > MAX_GROWTH:
            problems.append(f"{name} has grown by {growth:.1%} since a sixth of the time")
    if any(state.imbalance for state in states):
        problems.append("volume is out of balance")
    missing = elapsed - (last.sim_time - begin.sim_time) - (last.lost_time - begin.lost_time)
    if missing > 2.0:
        problems.append(f"{missing:.1f} s of simulation time are missing, and are not reported")
    return problems


def resident_memory(pid: int) -> float:
    """Return the resident memory of a process [MB]."""
    text = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    (line,) = (each for each in text.splitlines() if each.startswith("VmRSS:"))
    return float(line.split()[1]) / 1000.0


if __name__ == "__main__":
    sys.exit(main())

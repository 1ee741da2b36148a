"""Slow subscribers, a slow disk, a suspended viewer and a flood of commands stall no run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import disturbances
from benchmarks.disturbed_real_time import KINDS, measure
from benchmarks.real_time_load import START_TIMEOUT, DiggingNodes
from earthmoving_sim.multi_process.node_process import NodeProcess
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.bag.reader import BagReader

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

SECONDS = 6.0
MIN_FACTOR = 0.5
"""Minimum real-time factor while a run is disturbed, relative to that before: far below what is
measured (0.95 to 1), because other work on the machine slows runs down too. A stall gives 0."""


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("none", "slow_disk")])
def test_simulation_continues_while_it_is_disturbed(ros_domain: int, kind: str) -> None:
    result = measure(kind, SECONDS)
    assert result.factor_during > MIN_FACTOR * result.factor_before


def test_recorder_on_a_slow_disk_stalls_nothing_and_loses_nothing(
    ros_domain: int, tmp_path: Path
) -> None:
    run = DiggingNodes(tmp_path, 1)
    bag = tmp_path / "bag"
    recorder: NodeProcess | None = None
    try:
        arguments = ["slow_disk", str(bag), str(SECONDS)]
        recorder = NodeProcess("recorder", disturbances.MODULE, arguments, tmp_path / "log")
        run.spin_until(lambda: run.sim_time > 2.0, START_TIMEOUT)
        before = run.sample()
        run.spin_until(lambda: run.sim_time > 2.0 + 2.0 * SECONDS, START_TIMEOUT)
        after = run.sample()
    finally:
        run.stop()
        code = recorder.stop(60.0) if recorder is not None else 0
    assert (after.sim_time - before.sim_time) / (after.wall - before.wall) > MIN_FACTOR
    assert code == 0
    statuses = BagReader(bag).messages(["/recorder/status"])
    status = [json.loads(message.data) for _, _, message in statuses]
    assert max(each["bytes_queued"] for each in status) > 1_000_000
    assert status[-1]["num_lost"] == 0
    report = audit_bag(bag)
    assert report.balanced
    assert [run.max_imbalance_mm3 for run in report.runs] == [0]

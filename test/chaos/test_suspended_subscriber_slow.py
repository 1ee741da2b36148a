"""A subscriber that is suspended stalls neither the soil nor a machine."""

from __future__ import annotations

import itertools
import signal
import sys
import time
from pathlib import Path

import pytest
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

SUSPENDED_TIME = 9.0
"""Time for which the recorder is suspended [s], below the lease of a DDS participant (10 s)."""

MAX_GAP = 1.0
"""Maximum wall time between two ticks [s]; a stall in shared memory lasts 2 s."""


def test_suspended_recorder_does_not_stall_ticks(
    ros: Ros, ros_process: StartProcess, tmp_path: Path
) -> None:
    clocks = ros.collect("/clock", Clock)
    ros_process(
        [sys.executable, "-m", "soil_sim.node.soil_node"],
        parameters={"site.terrain": "flat", "site.num_points": 129, "sync": "lockstep"},
    )
    ros_process([sys.executable, "-m", "machine_sim.node.machine_node"], namespace="/excavator")
    recorder = ros_process(
        [sys.executable, "-m", "msg_bridge.recorder.recorder_node"],
        parameters={"path": str(tmp_path / "bag")},
    )
    ros.spin_until(lambda: len(clocks) > 100, timeout=120.0, what="tick 100")
    recorder.wait_for_output("recording into")
    recorder.interrupt(signal.SIGSTOP)
    try:
        arrivals, end = [time.monotonic()], time.monotonic() + SUSPENDED_TIME
        clocks.clear()
        while arrivals[-1] < end:
            ros.spin_until(lambda: bool(clocks), what="a tick")
            clocks.clear()
            arrivals.append(time.monotonic())
    finally:
        recorder.interrupt(signal.SIGCONT)
    gaps = [after - before for before, after in itertools.pairwise(arrivals)]
    assert max(gaps) < MAX_GAP
    assert ros.call(Trigger, "/soil/verify", Trigger.Request()).success
    recorder.stop()

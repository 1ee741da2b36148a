"""A flood of rows stalls a run in real time only as long as it lasts."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec import qos
from msg_bridge.codec.row_chunks import chunk_to_cdr
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract.messages import RowChunk, SoilHeader, Stream
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

FLOOD_TIME = 3.0
"""Duration of the flood [s]."""

MAX_RECOVERY_TIME = 10.0
"""Maximum time from the end of the flood until a second of ticks is complete [s]."""

NUM_MESSAGES = 200


def junk(kind: str, header: SoilHeader) -> list[tuple[Stream, bytes]]:
    """Return clouds of rows of the only machine that it has not sent."""
    rng, receipt, clouds = np.random.default_rng(0), header.receipts[0], []
    for _ in range(NUM_MESSAGES):
        for stream, dtype in ((Stream.SWEEP, SWEEP), (Stream.DEPOSIT_REQUEST, DEPOSIT_REQUEST)):
            rows = empty_rows(dtype, 500)
            rows["machine_id"] = receipt.machine_id
            first = rng.integers(1, 5000) if kind == "next numbers" else 0
            rows["seq"] = first + np.arange(rows.size)
            if kind == "random numbers":
                rows["seq"] = rng.integers(20_000, 3_900_000, rows.size)
            chunk = RowChunk(header.run_id, stream, receipt.machine_id, receipt.session_id, rows)
            data = chunk_to_cdr(chunk, "map", Time())
            clouds.append((stream, data[: len(data) // 2] if kind == "truncated" else data))
    return clouds


@pytest.mark.parametrize("kind", ["random numbers", "next numbers", "truncated"])
def test_ticks_continue_when_a_flood_of_rows_ends(
    ros: Ros, ros_process: StartProcess, kind: str
) -> None:
    received = ros.collect("/soil/tick", Int64MultiArray, qos.ROWS)

    def headers() -> list[SoilHeader]:
        found = [from_multi_array(message) for message in received[-200:]]
        return [each for each in found if isinstance(each, SoilHeader)]

    publishers = {
        Stream.SWEEP: ros.publisher("/soil/tool_sweeps", PointCloud2),
        Stream.DEPOSIT_REQUEST: ros.publisher("/soil/deposit_requests", PointCloud2),
    }
    ros_process(
        [sys.executable, "-m", "soil_sim.node.soil_node"],
        parameters={"site.terrain": "flat", "site.num_points": 129, "machine_timeout": 60.0},
    )
    ros_process([sys.executable, "-m", "machine_sim.node.machine_node"], namespace="/excavator")
    ros.spin_until(lambda: headers() and headers()[-1].tick > 100, timeout=120.0, what="tick 100")
    clouds = junk(kind, headers()[-1])
    end, count = time.monotonic() + FLOOD_TIME, 0
    while time.monotonic() < end:
        stream, data = clouds[count % len(clouds)]
        publishers[stream].publish(data)
        count += 1
    assert count > 1000
    received.clear()
    ros.spin_until(lambda: bool(headers()), timeout=MAX_RECOVERY_TIME, what="a tick")
    goal = headers()[0].tick + 100
    remaining = end + MAX_RECOVERY_TIME - time.monotonic()
    ros.spin_until(lambda: headers()[-1].tick >= goal, timeout=remaining, what="100 ticks")

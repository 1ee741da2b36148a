"""Measure what the recorder misses at a rate of data, and its CPU time, over DDS.

    python -m benchmarks.recorder_load                         # 30 MB/s with zstd, lz4 and none
    python -m benchmarks.recorder_load --rates 10 30 60 --compressions zstd

A process publishes messages of 1 MB, which are 5/6 of the data, and of 8 kB, reliable and as evenly
as it can; half of the bytes are random. The recorder runs with its default parameters. Messages
are counted by the publisher, in the bag, and as lost by the recorder.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import sys
import tempfile
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from earthmoving_sim.multi_process.node_process import NodeProcess

COLUMNS = (
    Column("sent", "MB/s", ".1f"),
    Column("missed", "messages", ".0f"),
    Column("counted as lost", "messages", ".0f"),
    Column("CPU", "%", ".0f"),
    Column("on disk", "MB/s", ".1f"),
)
LARGE, SMALL = 1_000_000, 8_000
"""Sizes of the messages [bytes]."""
LARGE_PART = 5 / 6
PERIOD = 0.02
"""Time between bursts of the publisher [s]."""
START_TIMEOUT = 30.0
TOPICS = ("/load/large", "/load/small")


class LoadResult(NamedTuple):
    """Result of a run: rates [bytes/s], numbers of messages, and CPU time over wall time [%]."""

    sent_rate: float
    num_missed: int
    num_lost: int
    cpu_percent: float
    disk_rate: float


def main() -> None:
    """Measure and print a row for each compression and rate."""
    parser = make_parser(__doc__, runs=3)
    parser.add_argument("--rates", type=float, nargs="+", default=[30.0], help="MB/s (30)")
    parser.add_argument(
        "--compressions", nargs="+", default=["zstd", "lz4", "none"], help="of the bag"
    )
    parser.add_argument("--seconds", type=float, default=20.0, help="wall time of a run (20)")
    options: argparse.Namespace = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    table.print_header("compression, rate")
    for compression in options.compressions:
        for rate in options.rates:
            results = [
                run_recorder(rate * 1e6, options.seconds, compression) for _ in range(options.runs)
            ]
            values = [statistics.median(each) for each in zip(*results, strict=True)]
            values[0], values[4] = values[0] / 1e6, values[4] / 1e6
            missed = ", ".join(f"{result.num_missed}" for result in results)
            table.print_row(f"{compression}, {rate:g} MB/s", values, remark=f"missed: {missed}")


def run_recorder(rate: float, seconds: float, compression: str) -> LoadResult:
    """Publish at a rate [bytes/s] for some seconds of wall time, and compare with the bag."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        arguments = ["--ros-args", "-p", f"path:={bag}", "-p", f"compression:={compression}"]
        arguments += ["-p", "include:=^/load/", "-p", "progress:=false"]
        recorder = NodeProcess(
            "exchange_recorder",
            "msg_bridge.recorder.recorder_node",
            arguments,
            Path(folder) / "recorder.log",
        )
        context = multiprocessing.get_context("spawn")
        queue, is_recorded = context.Queue(), context.Event()
        publisher = context.Process(target=publish, args=(rate, seconds, queue, is_recorded))
        publisher.start()
        queue.get(timeout=START_TIMEOUT)  # the first message is due
        cpu = -recorder.cpu_time
        num_sent, num_bytes, wall = queue.get(timeout=seconds + START_TIMEOUT)
        cpu += recorder.cpu_time
        recorder.stop()
        is_recorded.set()  # losses are counted while the publisher exists
        publisher.join()
        metadata = yaml.safe_load((bag / "metadata.yaml").read_text())
        information = metadata["rosbag2_bagfile_information"]
        lost = yaml.safe_load(information["custom_data"]["lost"])
        size = sum(each.stat().st_size for each in bag.glob("*.mcap"))
    return LoadResult(
        num_bytes / wall,
        num_sent - information["message_count"],
        sum(lost.values()),
        100.0 * cpu / wall,
        size / wall,
    )


def publish(
    rate: float,
    seconds: float,
    queue: multiprocessing.Queue[tuple[int, int, float]],
    is_recorded: Event,
) -> None:
    """Publish both topics at a rate [bytes/s].

    Args:
        rate: [bytes/s].
        seconds: wall time [s].
        queue: receives a first entry when the recorder is ready, and then number and size [bytes]
            of the messages and the wall time [s].
        is_recorded: is set when the recorder has ended.
    """
    import rclpy
    from rclpy.qos import QoSProfile
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import CompressedImage

    from msg_bridge.dds_profile import use_shipped_profile

    use_shipped_profile()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("recorder_load")
    publishers = [
        node.create_publisher(CompressedImage, topic, QoSProfile(depth=100)) for topic in TOPICS
    ]
    rng = np.random.default_rng(1)
    messages = []
    for size in (LARGE, SMALL):
        message = CompressedImage()
        message.data.frombytes(rng.bytes(size // 2) + bytes(size - size // 2))
        messages.append(message)
    deadline = time.monotonic() + START_TIMEOUT
    while any(not each.get_subscription_count() for each in publishers):
        if time.monotonic() > deadline:
            sys.exit("the recorder does not subscribe")
        time.sleep(0.05)
    queue.put((0, 0, 0.0))
    sizes, parts = (LARGE, SMALL), (LARGE_PART, 1 - LARGE_PART)
    counts = [0, 0]
    start = time.monotonic()
    while (elapsed := time.monotonic() - start) < seconds:
        for k in range(2):
            due = rate * parts[k] * elapsed / sizes[k]
            while counts[k] < due:
                publishers[k].publish(messages[k])
                counts[k] += 1
        time.sleep(PERIOD)
    wall = time.monotonic() - start
    for each in publishers:
        each.wait_for_all_acked()
    queue.put((sum(counts), sum(c * s for c, s in zip(counts, sizes, strict=True)), wall))
    is_recorded.wait()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()

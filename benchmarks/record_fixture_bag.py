"""Record the run of the bags `bags/format_*` in the repository with the current code.

    python -m benchmarks.record_fixture_bag bags/format_3

The run is one dig cycle of the demo's operator, with ROS nodes in lockstep, on a level site of
41 x 41 cells of 0.5 m, with ticks of 0.05 s and particles of 20 L. The recording is then reduced to
less than 1 MB: topics without a reader and repeated messages are omitted, states and particles are
thinned, and each topic gets one chunk with the strongest compression.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String
from zstandard import ZstdCompressor

from earthmoving_sim.multi_process.dig import run_multi_process_dig
from earthmoving_sim.run_config import RunConfig, load_run_config
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagWriter
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.recorder.recording import FORMAT_VERSION
from soil_sim.terrain import HeightMap

KEPT_TOPICS = (
    *("/diagnostics", "/sim/config", "/sim/paused", "/terrain/info", "/terrain/map"),
    *("/terrain/map_updates", "/soil/conversions", "/soil/deposit_requests", "/soil/forces"),
    *("/soil/join_rejections", "/soil/ledger", "/soil/state_hash", "/soil/tick"),
    *("/soil/tool_sweeps", "/excavator/config", "/excavator/conversion_backlog"),
    *("/excavator/joint_states", "/excavator/odom", "/excavator/operator/cycles"),
    *("/excavator/operator/phase", "/excavator/particles", "/excavator/soil_tick"),
    "/excavator/state_hash",
)
"""Topics in the bag: those that the audit and the outcome need, and a few small ones."""

THINNED = {
    "/diagnostics": 13,  # not a multiple of the number of nodes, which publish in turn
    "/terrain/map": 5,
    "/excavator/joint_states": 5,
    "/excavator/odom": 5,
    "/excavator/particles": 80,
}
"""Every n-th message and the last are kept, by topic."""
MAX_SIZE = 1_000_000
"""Maximum size of a bag [B]."""


def main() -> None:
    """Record, reduce, and check the size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path, help="folder to create")
    bag = parser.parse_args().bag
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        run_multi_process_dig(run_config(), level_site(), folder / "nodes", folder / "bag")
        reduce_bag(folder / "bag", bag, {f"{find_config('demo.yaml').parent}/": "", temporary: ""})
    size = sum(file.stat().st_size for file in bag.iterdir())
    print(f"{bag}: {size:,} bytes" + (f"; more than {MAX_SIZE:,}" if size > MAX_SIZE else ""))


def run_config() -> RunConfig:
    """Return the demo's configuration with one cycle, coarse ticks and large particles."""
    config = load_run_config("demo.yaml", {"cycles": 1, "start_x": 0.0, "approach_distance": 0.2})
    return replace(
        config,
        stepping=replace(config.stepping, steps_per_tick=10),
        particles=replace(config.particles, nominal_volume=20_000_000),
    )


def level_site() -> HeightMap:
    """Return level ground of 41 x 41 cells with a roughness of 0.02 m RMS."""
    grid = Grid(41, 41, 0.5)
    noise = np.random.default_rng(0).standard_normal(grid.shape)
    return HeightMap(grid, np.round(0.02 * noise, 3))


def reduce_bag(source: Path, target: Path, replacements: dict[str, str]) -> None:
    """Copy a bag with the kept topics only, thinned, and one chunk per topic.

    Args:
        source: the folder of a bag with one file.
        target: the folder to create.
        replacements: texts to replace in configurations, such as local paths.
    """
    channels: dict[str, tuple[Schema, Channel]] = {}
    messages: dict[str, list[Message]] = defaultdict(list)
    with next(source.glob("*.mcap")).open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(topics=KEPT_TOPICS):
            assert schema is not None
            channels[channel.topic] = (schema, channel)
            messages[channel.topic].append(message)
    # mcap's Writer has no compression level.
    with patch("mcap.writer.zstandard.compress", ZstdCompressor(level=22).compress):
        writer = BagWriter(target, chunk_size=1 << 30)
        for topic, (schema, channel) in channels.items():
            offered = [_offered_qos(each) for each in _offered_entries(channel)]
            writer.add_topic(topic, schema.name, offered, channel.metadata["topic_type_hash"])
            for message in _thin(topic, messages[topic]):
                data = _replace(topic, message.data, replacements)
                times = (message.log_time, message.publish_time)
                writer.write(topic, data, *times, message.sequence)
            writer.flush()
        writer.close({"format_version": FORMAT_VERSION})


def _thin(topic: str, messages: list[Message]) -> Iterable[Message]:
    """Return every n-th message and the last; equal messages count once."""
    different = list({message.data: message for message in reversed(messages)}.values())[::-1]
    return [*different[: -1 : THINNED.get(topic, 1)], different[-1]]


def _replace(topic: str, data: bytes, replacements: dict[str, str]) -> bytes:
    if not topic.endswith("/config"):
        return data
    text = str(deserialize_message(data, String).data)
    for old, new in replacements.items():
        text = text.replace(old, new)
    replaced: bytes = serialize_message(String(data=text))
    return replaced


def _offered_entries(channel: Channel) -> list[dict[str, str]]:
    entries: list[dict[str, str]] = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    return entries


def _offered_qos(entry: dict[str, str]) -> OfferedQos:
    return OfferedQos(reliability=entry["reliability"], durability=entry["durability"])


if __name__ == "__main__":
    main()

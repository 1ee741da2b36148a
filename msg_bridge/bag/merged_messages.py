"""The messages of all files of a bag, in the order of their log times."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence, Set

from mcap.records import Channel

from msg_bridge.bag.mcap_index import McapFile, read_messages
from msg_bridge.bag.terrain_deltas import TerrainRestorer, has_deltas

__all__ = ["TopicName", "merge_messages"]

TopicName = Callable[[McapFile, Channel], str | None]
"""Returns the current name of the topic of a channel; None if it is not read."""


def merge_messages(
    files: Sequence[McapFile], topic_name: TopicName, wanted: Set[str]
) -> Iterator[tuple[str, int, bytes]]:
    """Yield topic, log time [ns] and CDR bytes of messages; maps recorded as deltas are restored.

    A map whose keyframe is missing, as before a cut, is left out.

    Args:
        files: the indexed files of the bag.
        topic_name: returns the name of a topic.
        wanted: names of the requested topics.

    Raises:
        BagReadError: a chunk is damaged.
    """
    restorers: dict[str, TerrainRestorer] = defaultdict(TerrainRestorer)
    with_deltas = {
        topic_name(file, channel)
        for file in files
        for channel in file.channels.values()
        if has_deltas(file, channel)
    }
    for time, topic, data, is_delta in _merge_recorded(files, topic_name, wanted):
        if topic not in with_deltas:
            yield topic, time, data
        elif not is_delta:
            restorers[topic].add_keyframe(data)
            yield topic, time, data
        else:
            restored = restorers[topic].restore(data)
            if restored is not None:
                yield topic, time, restored


def _merge_recorded(
    files: Sequence[McapFile], topic_name: TopicName, wanted: Set[str]
) -> Iterator[tuple[int, str, bytes, bool]]:
    """Yield log time, topic and bytes of messages, and whether each is a delta of a map."""
    segments = sorted(segment for file in files for segment in file.segments)
    # Heap of time, order read, topic, data, whether it is a delta.
    pending: list[tuple[int, int, str, bytes, bool]] = []
    num_read = 0
    channels = [
        {
            each.id: (name, has_deltas(file, each))
            for each in file.channels.values()
            if (name := topic_name(file, each)) is not None and name in wanted
        }
        for file in files
    ]
    streams = [file.path.open("rb") for file in files]
    try:
        for segment in segments:
            while pending and pending[0][0] < segment.start_ns:
                time, _, topic, data, is_delta = heapq.heappop(pending)
                yield time, topic, data, is_delta
            own = channels[segment.file]
            for message in read_messages(files[segment.file], streams[segment.file], segment, own):
                name, is_delta = own[message.channel]
                num_read += 1
                heapq.heappush(pending, (message.log_time, num_read, name, message.data, is_delta))
        while pending:
            time, _, topic, data, is_delta = heapq.heappop(pending)
            yield time, topic, data, is_delta
    finally:
        for stream in streams:
            stream.close()

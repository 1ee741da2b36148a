"""The map updates of a bag that follow one of its terrain maps."""

from __future__ import annotations

import numpy as np

from msg_bridge.bag.message_index import MessageIndex
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.row_chunks import chunk_from_cdr
from msg_bridge.codec.terrain_delta import keyframe_identity
from msg_bridge.contract.messages import RowChunk, Stream

__all__ = ["find_map_updates"]

_MAX_OLDER = 100
"""Number of successive messages before a map with older revisions, after which none is expected to
be newer: rows that were lost are sent again among later ones."""


def find_map_updates(index: MessageIndex, topic: str, number: int, end: int) -> list[int]:
    """Return the numbers of the messages with the updates that a map lacks, ascending.

    Some are before it in the bag: the recorder repeats maps. They are found by their revision. Of a
    map without one, and of messages of earlier formats, they are the messages behind it.

    Args:
        index: the messages.
        topic: topic of the updates.
        number: number of the map.
        end: number before which the updates are.

    Raises:
        BagReadError: a chunk is damaged.
    """
    numbers = index.of_topic(topic)
    numbers = numbers[: np.searchsorted(numbers, end)]
    identity = keyframe_identity(index.read(number))
    if identity is None:
        return [int(each) for each in numbers[numbers > number]]
    found: list[int] = []
    num_older = 0
    for each in numbers[::-1].tolist():
        chunk, is_behind = _decode(index.read(each)), each > number
        if chunk is None:
            is_needed = is_behind
        else:
            is_newer = int(chunk.rows["revision"][-1]) > identity[1]
            is_needed = is_newer and chunk.run_id == identity[0]
        if is_needed:
            found.append(each)
        num_older = 0 if is_needed or is_behind else num_older + 1
        if num_older == _MAX_OLDER:
            break
    return found[::-1]


def _decode(data: bytes) -> RowChunk | None:
    """Return the rows of a message; None if they cannot be read."""
    try:
        return chunk_from_cdr(data, Stream.MAP_UPDATE)
    except CodecError:
        return None

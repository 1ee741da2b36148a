"""Terrain maps as their difference from an earlier map, on serialised messages.

A delta is a cloud of the columns that changed since a keyframe, each with all fields of a map, its
number `cell` in the order of the map, and the revision of the keyframe. `revision` changes in every
column of a map, so that it does not make a column one that changed; a delta has at least one
column, for the revision. Stamp and frame are those of the map. Applied to its keyframe, a delta
gives the same message again; padding of its fields, which is undefined, is that of the keyframe.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, STAMP, read_string, string_end
from msg_bridge.codec.cloud_layout import CloudLayout, PointBlock, layout_of_dtype
from msg_bridge.codec.terrain import TERRAIN_CELL

__all__ = ["TERRAIN_DELTA", "apply_delta", "base_of_delta", "encode_delta", "keyframe_identity"]

TERRAIN_DELTA: Final = np.dtype(
    [
        *((name, TERRAIN_CELL[name]) for name in TERRAIN_CELL.names or ()),
        ("cell", "<u4"),  # number of the column in the map: row * cols + col
        ("base_revision", "<u4"),  # revision of the keyframe; the same in every row
    ]
)
"""A row of a delta."""

_MAP, _DELTA = layout_of_dtype(TERRAIN_CELL), layout_of_dtype(TERRAIN_DELTA)
_WORD = 4
_NUM_WORDS = TERRAIN_CELL.itemsize // _WORD
_REVISION_WORD = next(f.offset for f in _MAP.fields if f.name == "revision") // _WORD
_FRAME_ID_OFFSET = len(LITTLE_ENDIAN) + STAMP.size
_SHAPE = struct.Struct("<II")
_ROW_STEP_AND_SIZE = struct.Struct("<II")
_IS_DENSE = b"\x01"


def keyframe_identity(data: bytes) -> tuple[int, int] | None:
    """Return run id and revision of a serialised map; None if it has another layout."""
    cells = _cells(data, _MAP, TERRAIN_CELL)
    if cells is None or not cells.size:
        return None
    return int(cells["run_id"][0]), int(cells["revision"][0])


def base_of_delta(data: bytes) -> tuple[int, int] | None:
    """Return run id and revision of the keyframe of a delta; None if it has another layout."""
    rows = _cells(data, _DELTA, TERRAIN_DELTA)
    if rows is None or not rows.size:
        return None
    return int(rows["run_id"][0]), int(rows["base_revision"][0])


def encode_delta(keyframe: bytes, new: bytes) -> bytes | None:
    """Return a map as its difference from a keyframe.

    Args:
        keyframe, new: serialised maps.

    Returns:
        The delta as a serialised PointCloud2; None if the map cannot be restored from it, or it
        would not be smaller than the map.
    """
    before, after = _cells(keyframe, _MAP, TERRAIN_CELL), _cells(new, _MAP, TERRAIN_CELL)
    if before is None or after is None or before.size != after.size or not after.size:
        return None
    differs = _words(before) != _words(after)
    differs[:, _REVISION_WORD] = False
    (numbers,) = np.nonzero(differs.any(axis=1))
    if not numbers.size:
        numbers = np.zeros(1, dtype=np.intp)
    if numbers.size * TERRAIN_DELTA.itemsize >= after.nbytes:
        return None
    rows = np.empty(numbers.size, dtype=TERRAIN_DELTA)
    for name in TERRAIN_CELL.names or ():
        rows[name] = after[name][numbers]
    rows["cell"] = numbers
    rows["base_revision"] = before["revision"][0]
    delta = _to_cdr(new, rows)
    restored = apply_delta(keyframe, delta)
    return delta if restored is not None and _is_same_message(restored, new) else None


def apply_delta(keyframe: bytes, delta: bytes) -> bytes | None:
    """Return the serialised map of a delta.

    Args:
        keyframe: the serialised map that it is based on.
        delta: the serialised delta.

    Returns:
        None if they do not belong together.
    """
    rows = _cells(delta, _DELTA, TERRAIN_DELTA)
    block = _MAP.find_points(keyframe)
    if (
        rows is None
        or block is None
        or not rows.size
        or base_of_delta(delta) != (keyframe_identity(keyframe))
    ):
        return None
    count = block.height * block.width
    if int(rows["cell"].max()) >= count:
        return None
    result = bytearray(keyframe)
    begin, end = len(LITTLE_ENDIAN), _FRAME_ID_OFFSET
    result[begin:end] = delta[begin:end]
    cells = np.frombuffer(result, TERRAIN_CELL, count, block.offset)
    cells["revision"] = rows["revision"][0]
    for name in TERRAIN_CELL.names or ():
        cells[name][rows["cell"]] = rows[name]
    return bytes(result)


def _is_same_message(first: bytes, second: bytes) -> bool:
    """Return whether two serialised maps differ in padding only."""
    blocks = _MAP.find_points(first), _MAP.find_points(second)
    if blocks[0] is None or blocks[1] is None or blocks[0] != blocks[1]:
        return False
    begin = blocks[0].offset
    end = begin + blocks[0].height * blocks[0].width * TERRAIN_CELL.itemsize + len(_IS_DENSE)
    stamps = [data[len(LITTLE_ENDIAN) : _FRAME_ID_OFFSET] for data in (first, second)]
    frames = [read_string(data, _FRAME_ID_OFFSET) for data in (first, second)]
    return (
        stamps[0] == stamps[1] and frames[0] == frames[1] and first[begin:end] == second[begin:end]
    )


def _cells(data: bytes, layout: CloudLayout, dtype: np.dtype[np.void]) -> NDArray[np.void] | None:
    """Return the points of a serialised cloud; None if it has another layout."""
    block: PointBlock | None = layout.find_points(data)
    if block is None:
        return None
    return np.frombuffer(data, dtype, block.height * block.width, block.offset)


def _words(cells: NDArray[np.void]) -> NDArray[np.uint32]:
    return cells.view(np.uint32).reshape(cells.size, _NUM_WORDS)


def _to_cdr(source: bytes, rows: NDArray[np.void]) -> bytes:
    """Serialise a cloud of height 1 with the stamp and frame of another message."""
    size = rows.nbytes
    return b"".join(
        [
            source[: string_end(source, _FRAME_ID_OFFSET)],
            _SHAPE.pack(1, rows.size),
            _DELTA.description,
            _ROW_STEP_AND_SIZE.pack(size, size),
            rows.tobytes(),
            _IS_DENSE,
        ]
    )

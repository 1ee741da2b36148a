"""Terrain maps as their difference from an earlier map, on serialised messages.

A delta is a cloud of the columns that changed since a keyframe, each with all fields of a map, its
number `cell` in the order of the map, and the revision of the keyframe. `revision` changes in every
column of a map, so that it does not make a column one that changed; a delta has at least one
column, for the revision. Stamp and frame are those of the map. Applied to its keyframe, a delta
gives the same message again; padding of its fields, which is undefined, is that of the keyframe.

Maps of older bags lack `rut_depth`. Their deltas are applied, too.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, STAMP, read_string, string_end
from msg_bridge.codec.cloud_layout import CloudLayout, PointBlock, layout_of_dtype
from msg_bridge.codec.terrain import TERRAIN_CELL

__all__ = ["TERRAIN_DELTA", "apply_delta", "base_of_delta", "encode_delta", "keyframe_identity"]


class _Format(NamedTuple):
    """Rows of maps and of their deltas.

    Attributes:
        cell, delta: rows of a map and of a delta.
        map_layout, delta_layout: their layouts.
    """

    cell: np.dtype[np.void]
    delta: np.dtype[np.void]
    map_layout: CloudLayout
    delta_layout: CloudLayout

    @classmethod
    def of(cls, cell: np.dtype[np.void]) -> _Format:
        """Return the format of maps of a row."""
        delta = np.dtype(
            [
                *((name, cell[name]) for name in cell.names or ()),
                ("cell", "<u4"),  # number of the column in the map: row * cols + col
                ("base_revision", "<u4"),  # revision of the keyframe; the same in every row
            ]
        )
        return cls(cell, delta, layout_of_dtype(cell), layout_of_dtype(delta))


_CURRENT: Final = _Format.of(TERRAIN_CELL)
_FORMATS: Final = (
    _CURRENT,
    _Format.of(
        np.dtype([(n, TERRAIN_CELL[n]) for n in TERRAIN_CELL.names or () if n != "rut_depth"])
    ),
)
TERRAIN_DELTA: Final = _CURRENT.delta
"""A row of a delta."""

_WORD = 4
_NUM_WORDS = TERRAIN_CELL.itemsize // _WORD
_REVISION_WORD = next(f.offset for f in _CURRENT.map_layout.fields if f.name == "revision") // _WORD
_FRAME_ID_OFFSET = len(LITTLE_ENDIAN) + STAMP.size
_SHAPE = struct.Struct("<II")
_ROW_STEP_AND_SIZE = struct.Struct("<II")
_IS_DENSE = b"\x01"


def keyframe_identity(data: bytes) -> tuple[int, int] | None:
    """Return run id and revision of a serialised map; None if it has another layout."""
    for each in _FORMATS:
        cells = _cells(data, each.map_layout, each.cell)
        if cells is not None and cells.size:
            return int(cells["run_id"][0]), int(cells["revision"][0])
    return None


def base_of_delta(data: bytes) -> tuple[int, int] | None:
    """Return run id and revision of the keyframe of a delta; None if it has another layout."""
    for each in _FORMATS:
        rows = _cells(data, each.delta_layout, each.delta)
        if rows is not None and rows.size:
            return int(rows["run_id"][0]), int(rows["base_revision"][0])
    return None


def encode_delta(keyframe: bytes, new: bytes) -> bytes | None:
    """Return a map as its difference from a keyframe.

    Args:
        keyframe, new: serialised maps.

    Returns:
        The delta as a serialised PointCloud2; None if the map cannot be restored from it, or it
        would not be smaller than the map.
    """
    before, after = (_cells(each, _CURRENT.map_layout, TERRAIN_CELL) for each in (keyframe, new))
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
    for each in _FORMATS:
        rows = _cells(delta, each.delta_layout, each.delta)
        block = each.map_layout.find_points(keyframe)
        if rows is not None and rows.size and block is not None:
            return _apply(keyframe, block, delta, rows, each.cell)
    return None


def _apply(
    keyframe: bytes,
    block: PointBlock,
    delta: bytes,
    rows: NDArray[np.void],
    cell: np.dtype[np.void],
) -> bytes | None:
    """Return the map of the rows of a delta; None if they are not of this keyframe.

    Args:
        keyframe, block: the serialised keyframe and where its points are.
        delta, rows: the serialised delta and its rows.
        cell: rows of the keyframe.
    """
    count = block.height * block.width
    if base_of_delta(delta) != keyframe_identity(keyframe) or int(rows["cell"].max()) >= count:
        return None
    result = bytearray(keyframe)
    begin, end = len(LITTLE_ENDIAN), _FRAME_ID_OFFSET
    result[begin:end] = delta[begin:end]
    cells = np.frombuffer(result, cell, count, block.offset)
    cells["revision"] = rows["revision"][0]
    for name in cell.names or ():
        cells[name][rows["cell"]] = rows[name]
    return bytes(result)


def _is_same_message(first: bytes, second: bytes) -> bool:
    """Return whether two serialised maps differ in padding only."""
    blocks = tuple(_CURRENT.map_layout.find_points(each) for each in (first, second))
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
            _CURRENT.delta_layout.description,
            _ROW_STEP_AND_SIZE.pack(size, size),
            rows.tobytes(),
            _IS_DENSE,
        ]
    )

"""A graph of objects as bytes, in which arrays that share memory share it again when loaded.

The state of a simulation has many views of the same memory: columns of a table, tables that are
boxed for kernels. Pickle copies each of them on its own. Here an array is stored as an address, and
the memory at all addresses once; each range of memory keeps its alignment, which kernels depend on.
"""

from __future__ import annotations

import ctypes
import io
import pickle
from bisect import bisect_right
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray

__all__ = ["CapturedState", "capture_state", "dump_state", "load_state"]

_ALIGNMENT = 64
"""Alignment that a range of memory keeps [bytes]: that of the widest vectors."""

_SIZE_BYTES = 8
"""Length of the number that precedes the pickled objects [bytes]."""


class _ArrayPlace(NamedTuple):
    """Where an array is in memory."""

    address: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    dtype: np.dtype[Any]
    is_writeable: bool


class _Range(NamedTuple):
    """A range of memory."""

    address: int
    content: bytes


class CapturedState(NamedTuple):
    """A graph of objects as it was in one moment, for another thread to compress and write.

    Attributes:
        ranges: memory of the arrays.
        stream: the pickled objects, with arrays as places in that memory.
    """

    ranges: list[_Range]
    stream: bytes

    def compress(self) -> bytes:
        """Return it as bytes for `load_state`; other threads run meanwhile."""
        sizes = [(each.address, len(each.content)) for each in self.ranges]
        head = pickle.dumps((sizes, self.stream), protocol=pickle.HIGHEST_PROTOCOL)
        compressor = zstandard.ZstdCompressor().compressobj()
        parts = [len(head).to_bytes(_SIZE_BYTES, "little"), head]
        parts += [each.content for each in self.ranges]
        return b"".join([*map(compressor.compress, parts), compressor.flush()])


def capture_state(state: Any) -> CapturedState:
    """Return a copy of a graph of objects.

    Arrays of objects, and subclasses of arrays, are pickled as usual.

    Raises:
        pickle.PicklingError, TypeError, AttributeError: an object cannot be pickled.
    """
    stream = io.BytesIO()
    pickler = _StatePickler(stream)
    pickler.dump(state)
    ranges = [_read_memory(*each) for each in _merge(pickler.ranges)]
    return CapturedState(ranges, stream.getvalue())


def dump_state(state: Any) -> bytes:
    """Return a graph of objects as compressed bytes, see `capture_state`."""
    return capture_state(state).compress()


def load_state(data: bytes) -> Any:
    """Return the objects of `dump_state`.

    Only load data that this program has written: pickle can run any code.

    Raises:
        zstandard.ZstdError, EOFError, pickle.UnpicklingError: no such data.
        AttributeError, ImportError, TypeError: it is of another version.
    """
    content = zstandard.ZstdDecompressor().decompressobj().decompress(data)
    begin = _SIZE_BYTES + int.from_bytes(content[:_SIZE_BYTES], "little")
    sizes, stream = pickle.loads(content[_SIZE_BYTES:begin])
    ranges = []
    for address, size in sizes:
        ranges.append(_Range(address, content[begin : begin + size]))
        begin += size
    return _StateUnpickler(stream, ranges).load()


class _StatePickler(pickle.Pickler):
    """Pickles arrays as their places.

    Attributes:
        ranges: begin and end address of each array, which may overlap.
    """

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, protocol=pickle.HIGHEST_PROTOCOL)
        self.ranges: list[tuple[int, int]] = []
        self._arrays: list[NDArray[Any]] = []  # temporary ones must not be freed before the end

    def persistent_id(self, obj: Any) -> _ArrayPlace | None:
        """Return the place of an array; None for other objects."""
        if type(obj) is not np.ndarray or obj.dtype.hasobject:
            return None
        self._arrays.append(obj)
        address = int(obj.__array_interface__["data"][0])
        low, high = _byte_bounds(obj)
        if high > low:
            self.ranges.append((low, high))
        return _ArrayPlace(address, obj.shape, obj.strides, obj.dtype, obj.flags.writeable)


class _StateUnpickler(pickle.Unpickler):
    """Loads arrays from their places."""

    def __init__(self, content: bytes, ranges: Iterable[_Range]) -> None:
        super().__init__(io.BytesIO(content))
        self._starts, self._memory = [], []
        for each in ranges:
            self._starts.append(each.address)
            self._memory.append(_aligned_copy(each))
        self._arrays: dict[tuple[Any, ...], NDArray[Any]] = {}

    def persistent_load(self, pid: Any) -> NDArray[Any]:
        """Return the array of a place, the same object for the same place."""
        place = _ArrayPlace(*pid)
        key = (*place[:3], place.dtype.str, str(place.dtype.descr), place.is_writeable)
        if key not in self._arrays:
            self._arrays[key] = self._array(place)
        return self._arrays[key]

    def _array(self, place: _ArrayPlace) -> NDArray[Any]:
        if 0 in place.shape:
            array = np.empty(place.shape, dtype=place.dtype)
        else:
            k = bisect_right(self._starts, place.address) - 1
            array = np.ndarray(
                place.shape,
                place.dtype,
                buffer=self._memory[k],
                offset=place.address - self._starts[k],
                strides=place.strides,
            )
        array.flags.writeable = place.is_writeable
        return array


def _byte_bounds(array: NDArray[Any]) -> tuple[int, int]:
    """Return the address of the first byte of an array, and that after its last one."""
    if array.size == 0:
        return 0, 0
    low = high = int(array.__array_interface__["data"][0])
    for count, stride in zip(array.shape, array.strides, strict=True):
        extent = (count - 1) * stride
        low, high = (low + extent, high) if extent < 0 else (low, high + extent)
    return low, high + array.itemsize


def _merge(ranges: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return ranges without overlap that cover the same memory, ascending."""
    merged: list[tuple[int, int]] = []
    for low, high in sorted(ranges):
        if merged and low < merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return merged


def _read_memory(low: int, high: int) -> _Range:
    return _Range(low, ctypes.string_at(low, high - low))


def _aligned_copy(each: _Range) -> NDArray[np.uint8]:
    """Return writable memory with the content of a range, at an address of the same alignment."""
    content = np.frombuffer(each.content, dtype=np.uint8)
    memory = np.empty(content.size + _ALIGNMENT, dtype=np.uint8)
    offset = (each.address - int(memory.__array_interface__["data"][0])) % _ALIGNMENT
    copy = memory[offset : offset + content.size]
    copy[:] = content
    return copy

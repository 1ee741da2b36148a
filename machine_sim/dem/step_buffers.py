"""Working memory of a step, kept from step to step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.body_records import BODY_RECORD_SIZE, FORCE_RECORD_SIZE
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["StepBuffers", "StepMemory"]

_CACHE_LINE = 64
"""Size of a cache line [bytes]: that of a record."""


class StepMemory(NamedTuple):
    """Working memory of a step, for kernels.

    Attributes:
        body: float32 records of the bodies, see `body_records`.
        force_sums: sums of contact forces, see `body_records`.
        inside: index of the tool in whose hull each of the rows is that move by forces, int64.
        moving_rows, locked_tools: the rows and tools of `MovingRows`, int64.
        all_rows: the numbers of all rows, int64.
    """

    body: NDArray[np.float32]
    force_sums: NDArray[np.float32]
    inside: NDArray[np.int64]
    moving_rows: NDArray[np.int64]
    locked_tools: NDArray[np.int64]
    all_rows: NDArray[np.int64]


class StepBuffers:
    """Arrays with a row for each particle and each tool, and spare capacity.

    Attributes:
        capacity: number of rows.
        memory, boxed_memory: the arrays, for kernels.
    """

    def __init__(self) -> None:
        self._allocate(0)

    def reserve(self, count: int) -> bool:
        """Make room for `count` rows; return whether that cleared the arrays."""
        if self.capacity >= count:
            return False
        self._allocate(max(count, 2 * self.capacity))
        return True

    def _allocate(self, count: int) -> None:
        self.capacity = count
        self.memory = StepMemory(
            _records(count, BODY_RECORD_SIZE),
            _records(count, FORCE_RECORD_SIZE),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.arange(count, dtype=np.int64),
        )
        self.boxed_memory: BoxedTable = box_table(self.memory)


def _records(count: int, size: int) -> NDArray[np.float32]:
    """Return zeroed records that start with a cache line, float32, shape (count, size).

    NumPy aligns arrays to 16 bytes. A record in two cache lines instead of one costs a quarter of
    the time of a step.
    """
    num_bytes = count * size * np.dtype(np.float32).itemsize
    memory = np.zeros(num_bytes + _CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % _CACHE_LINE
    return memory[start : start + num_bytes].view(np.float32).reshape(count, size)

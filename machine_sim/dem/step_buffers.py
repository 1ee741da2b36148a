"""Working memory of a step, kept from step to step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.body_records import BODY_RECORD_SIZE, FORCE_RECORD_SIZE
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["StepBuffers", "StepMemory"]


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
            np.zeros((count, BODY_RECORD_SIZE), np.float32),
            np.zeros((count, FORCE_RECORD_SIZE), np.float32),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.arange(count, dtype=np.int64),
        )
        self.boxed_memory: BoxedTable = box_table(self.memory)

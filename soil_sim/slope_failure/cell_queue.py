"""FIFO queue of columns, without duplicates, that kernels and Python share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper

__all__ = [
    "CellQueue",
    "create_cell_queue",
    "dequeue",
    "enqueue",
    "is_empty",
    "pop_all",
    "queue_length",
    "queued_cells",
]

_HEAD, _TAIL = 0, 1


class CellQueue(NamedTuple):
    """A ring buffer of columns.

    Attributes:
        buffer: flat indices of columns, shape (columns + 1,), int64.
        is_queued: 1 for columns in the queue, shape (columns,), uint8.
        head_tail: positions in the buffer of the first column and after the last one, shape (2,),
            int64; equal if the queue is empty.
    """

    buffer: NDArray[np.int64]
    is_queued: NDArray[np.uint8]
    head_tail: NDArray[np.int64]


def create_cell_queue(columns: int) -> CellQueue:
    """Return an empty queue for a map with a number of columns."""
    return CellQueue(
        np.zeros(columns + 1, dtype=np.int64),
        np.zeros(columns, dtype=np.uint8),
        np.zeros(2, dtype=np.int64),
    )


def queue_length(queue: CellQueue) -> int:
    """Return the number of columns in the queue."""
    head, tail = queue.head_tail.tolist()
    return int((tail - head) % queue.buffer.size)


def queued_cells(queue: CellQueue) -> NDArray[np.int64]:
    """Return the flat indices of the columns in the queue, in their order."""
    head, tail = queue.head_tail.tolist()
    if head <= tail:
        return queue.buffer[head:tail].copy()
    return np.concatenate([queue.buffer[head:], queue.buffer[:tail]])


def pop_all(queue: CellQueue) -> NDArray[np.int64]:
    """Remove all columns from the queue; return their flat indices, in their order."""
    cells = queued_cells(queue)
    queue.is_queued[cells] = 0
    queue.head_tail[:] = 0
    return cells


@helper(forceinline=True)
def is_empty(queue):  # type: ignore[no-untyped-def]
    """Return whether no column is in the queue."""
    return queue.head_tail[_HEAD] == queue.head_tail[_TAIL]


@helper(forceinline=True)
def enqueue(queue, i):  # type: ignore[no-untyped-def]
    """Append column i unless it is in the queue."""
    if queue.is_queued[i] == 0:
        queue.is_queued[i] = 1
        queue.buffer[queue.head_tail[_TAIL]] = i
        queue.head_tail[_TAIL] = (queue.head_tail[_TAIL] + 1) % queue.buffer.size


@helper(forceinline=True)
def dequeue(queue):  # type: ignore[no-untyped-def]
    """Remove the first column of a queue that is not empty; return its flat index."""
    i = queue.buffer[queue.head_tail[_HEAD]]
    queue.head_tail[_HEAD] = (queue.head_tail[_HEAD] + 1) % queue.buffer.size
    queue.is_queued[i] = 0
    return i

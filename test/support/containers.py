"""Points in containers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.tools.open_container import (
    OpenContainer,
    is_in_heap,
    is_in_struck_volume,
    local_point,
)
from msg_bridge.kernels import kernel

_AT_ORIGIN = np.eye(3), np.zeros(3)


def rows_in_heap(
    shape: OpenContainer,
    points: NDArray[np.float64],
    pose: tuple[NDArray[np.float64], NDArray[np.float64]] = _AT_ORIGIN,
) -> list[int]:
    """Return the rows of the points [m], shape (n, 3), in the struck volume or in the heap."""
    return np.flatnonzero(_are_in_heap(shape.boxed, points, *pose)).tolist()


@kernel
def _are_in_heap(boxed_container, points, rotation, origin):  # type: ignore[no-untyped-def]
    container = boxed_container.table
    is_inside = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        is_near, x, z = local_point(points, i, container, rotation, origin)
        is_inside[i] = is_near and (
            is_in_struck_volume(x, z, container) or is_in_heap(x, z, container)
        )
    return is_inside

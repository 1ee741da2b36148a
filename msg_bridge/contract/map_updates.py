"""Select map updates, and apply them to the layers of a keyframe."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.rows import Rows

__all__ = ["apply_map_updates", "map_updates_after"]


def apply_map_updates(rows: Rows, layers: Mapping[str, NDArray[Any]]) -> None:
    """Set the updated cells of some layers. Each row has the complete state of its cell.

    Args:
        rows: MAP_UPDATE rows in the order of their numbers; of several rows of one cell the last
            counts.
        layers: arrays to change, shape (rows, cols), by the name of the field with their values.

    Raises:
        ExchangeError: OFF_MAP: a cell lies outside of the layers; nothing was changed.
    """
    for name, layer in layers.items():
        num_rows, num_cols = layer.shape
        if (rows["row"] >= num_rows).any() or (rows["col"] >= num_cols).any():
            raise ExchangeError(
                f"a map update lies outside of the {num_rows} x {num_cols} cells of {name}; the"
                " keyframe is of another grid",
                ErrorCode.OFF_MAP,
            )
    for name, layer in layers.items():
        layer[rows["row"], rows["col"]] = rows[name]


def map_updates_after(revision: int, rows: Rows) -> Rows:
    """Return the MAP_UPDATE rows of revisions after one; the same array if all rows are.

    Revisions in rows are modulo 2**32: the half of all others that follows counts as later.
    """
    if rows.size == 0:
        return rows
    column = rows["revision"]
    # The rows of a tick have one revision: for them faster than NumPy.
    revisions = set(column.tolist())
    later = [each for each in revisions if (each - revision - 1) % 2**32 < 2**31 - 1]
    return rows if len(later) == len(revisions) else rows[np.isin(column, later)]

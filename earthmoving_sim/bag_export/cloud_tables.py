"""Points of clouds as rows, each row of the exchange once."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from earthmoving_sim.bag_export.columns import LOG_TIME, arrow_field, with_free_names
from earthmoving_sim.bag_export.units import unit_of
from earthmoving_sim.received_numbers import ReceivedNumbers

__all__ = ["CloudTable"]

_NANO = 10**9
_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy types by PointField.datatype."""

_SENDER_FIELDS = ("run_id", "machine_id", "session_id")


class CloudTable:
    """A row for each point of PointCloud2 messages of one layout.

    Organised clouds (of several rows) have the columns `row` and `col`. Rows that are numbered by
    `seq` in a run are rows of the exchange: those that were sent again are left out.

    Attributes:
        schema: columns of the table.
        num_pending: number of rows since the last `take`.
    """

    def __init__(self, first: Any) -> None:
        """
        Args:
            first: the first message, whose layout all must have.
        """
        self.num_pending = 0
        self._pending: list[tuple[int, int, int, NDArray[np.void]]] = []
        self._layout = _layout(first)
        self._dtype = _dtype(first)
        names = self._dtype.names or ()
        self._is_organised = first.height > 1 and not {"row", "col"} & set(names)
        self._is_numbered = {"seq", "run_id"} <= set(names)
        self._received: dict[tuple[int, ...], ReceivedNumbers] = defaultdict(ReceivedNumbers)
        fields = [LOG_TIME, arrow_field("stamp", pa.timestamp("ns"))]
        if self._is_organised:
            fields += [arrow_field("row", pa.uint32()), arrow_field("col", pa.uint32())]
        of_points = [_point_field(name, self._dtype[name]) for name in names]
        self.schema = pa.schema([*fields, *with_free_names(of_points, [f.name for f in fields])])

    def add(self, time: int, message: Any) -> bool:
        """Add the rows of a message; return whether it has the layout of the first one.

        Args:
            time: log time [ns].
            message: the message.
        """
        points = self._points(message)
        if points is None:
            return False
        if self._is_numbered and points.size:
            points = points[self._find_new(points)]
        stamp = int(message.header.stamp.sec) * _NANO + int(message.header.stamp.nanosec)
        self._pending.append((time, stamp, message.width, points))
        self.num_pending += points.size
        return True

    @property
    def has_pending(self) -> bool:
        """Whether there are messages since the last `take`, with or without rows."""
        return bool(self._pending)

    def take(self) -> pa.RecordBatch:
        """Return the rows added since the last call."""
        pending, self._pending = self._pending, []
        self.num_pending = 0
        counts = [points.size for *_, points in pending]
        arrays = [
            pa.array(np.repeat(np.array(values, dtype=np.int64), counts)).view(kind)
            for values, kind in (
                ([time for time, *_ in pending], LOG_TIME.type),
                ([stamp for _, stamp, *_ in pending], pa.timestamp("ns")),
            )
        ]
        if self._is_organised:
            places = [
                np.divmod(np.arange(points.size, dtype=np.uint32), np.uint32(max(width, 1)))
                for *_, width, points in pending
            ]
            arrays += [pa.array(np.concatenate(parts)) for parts in zip(*places, strict=True)]
        points = np.concatenate([points for *_, points in pending])
        arrays += [_column(points[name]) for name in self._dtype.names or ()]
        return pa.RecordBatch.from_arrays(arrays, schema=self.schema)

    def _points(self, message: Any) -> NDArray[np.void] | None:
        """Return the points of a message, shape (n,), in native byte order."""
        data = np.asarray(message.data, dtype=np.uint8)
        row_size = message.width * message.point_step
        if _layout(message) != self._layout or data.size < message.height * message.row_step:
            return None
        if message.row_step < row_size:
            return None
        rows = data[: message.height * message.row_step].reshape(message.height, -1)
        packed = np.ascontiguousarray(rows[:, :row_size])
        points: NDArray[np.void] = packed.reshape(-1).view(self._dtype)
        return points

    def _find_new(self, points: NDArray[np.void]) -> NDArray[np.bool_]:
        """Return which rows have not been received before."""
        first = points[0]
        names = [name for name in _SENDER_FIELDS if name in (self._dtype.names or ())]
        # Rows of the soil are numbered together for all machines.
        if "session_id" not in names:
            names = ["run_id"]
        received = self._received[tuple(int(first[name]) for name in names)]
        return received.add(points["seq"].astype(np.int64))


def _point_field(name: str, dtype: np.dtype[Any]) -> pa.Field:
    """Return the column of a field of the points."""
    kind = pa.from_numpy_dtype(dtype.base)
    return arrow_field(name, pa.list_(kind, dtype.shape[0]) if dtype.shape else kind, unit_of(name))


def _layout(message: Any) -> tuple[Any, ...]:
    fields = tuple((each.name, each.offset, each.datatype, each.count) for each in message.fields)
    return (fields, message.point_step, message.is_bigendian, message.height > 1)


def _dtype(message: Any) -> np.dtype[np.void]:
    order = ">" if message.is_bigendian else "<"
    fields = list(message.fields)
    kinds = [np.dtype(order + _KINDS[each.datatype]) for each in fields]
    return np.dtype(
        {
            "names": [each.name for each in fields],
            "formats": [
                kind if each.count <= 1 else (kind, (each.count,))
                for each, kind in zip(fields, kinds, strict=True)
            ],
            "offsets": [each.offset for each in fields],
            "itemsize": message.point_step,
        }
    )


def _column(values: NDArray[Any]) -> pa.Array:
    native = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("="), copy=False)
    if native.ndim == 1:
        return pa.array(native)
    return pa.FixedSizeListArray.from_arrays(pa.array(native.reshape(-1)), native.shape[1])

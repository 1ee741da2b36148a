"""Measure the conversion of rows and terrain to messages and back.

    python -m benchmarks.message_codec

Prints the minimum wall time of 100 calls. Serialisation is that of rclpy, for comparison.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.codec.row_chunks import from_chunk_cloud, to_chunk_cloud
from msg_bridge.codec.terrain import TerrainMap, from_terrain_cloud, to_terrain_cloud
from msg_bridge.codec.tick_headers import from_multi_array, to_multi_array
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import (
    Keyframe,
    MachineReceipt,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import CONVERSION, Rows
from msg_bridge.exchange.chunks import MAX_ROWS_PER_CHUNK

STAMP = Time(sec=1)

COLUMNS = (
    *(Column("bytes", "", "d"), Column("pack"), Column("serialise")),
    *(Column("deserialise"), Column("unpack")),
)


def min_time(work: Callable[[], object]) -> float:
    """Return the minimum wall time of a call [ms]."""
    work()
    return 1e3 * min(timeit.repeat(work, number=1, repeat=100))


def measure_codec(
    table: ResultTable, name: str, pack: Callable[[], Any], unpack: Callable[[Any], object]
) -> None:
    """Measure one kind of message and print its row."""
    msg = pack()
    serialised = serialize_message(msg)
    times = (
        min_time(pack),
        min_time(lambda: serialize_message(msg)),
        min_time(lambda: deserialize_message(serialised, type(msg))),
        min_time(lambda: unpack(msg)),
    )
    table.print_row(name, [len(serialised), *times])


def random_rows(count: int) -> Rows:
    """Return CONVERSION rows of random bytes."""
    raw = np.random.default_rng(1).integers(0, 256, (count, CONVERSION.itemsize), dtype=np.uint8)
    return raw.reshape(-1).view(CONVERSION)


def random_terrain(size: int) -> TerrainMap:
    """Return a map of size x size columns with random heights and volumes."""
    rng = np.random.default_rng(1)
    grid = Grid(size, size, 0.2)
    volume = rng.integers(0, 10**12, grid.shape)
    frame = Keyframe(1, 7, grid, rng.normal(size=grid.shape), volume)
    return TerrainMap(frame, rng.random(grid.shape))


def main() -> None:
    """Measure and print the table."""
    options = make_parser(__doc__).parse_args()
    header = SoilHeader(1, 1, 1, *(RowRange(1, 9),) * 3, (MachineReceipt(1, 1, 1, 1),) * 2)
    chunk = RowChunk(1, Stream.CONVERSION, 0, 0, random_rows(MAX_ROWS_PER_CHUNK))
    many_rows, terrain = random_rows(100_000), random_terrain(513)
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(describe_load())
    table.print_header("ms")
    measure_codec(
        table,
        "100000 conversion rows",
        lambda: to_point_cloud(many_rows, "map", STAMP),
        lambda msg: from_point_cloud(msg, CONVERSION),
    )
    measure_codec(
        table,
        f"chunk of {MAX_ROWS_PER_CHUNK} rows",
        lambda: to_chunk_cloud(chunk, "map", STAMP),
        lambda msg: from_chunk_cloud(msg, Stream.CONVERSION),
    )
    measure_codec(
        table,
        "513 x 513 keyframe",
        lambda: to_terrain_cloud(terrain, "map", STAMP),
        from_terrain_cloud,
    )
    measure_codec(
        table, "soil header, 2 machines", lambda: to_multi_array(header), from_multi_array
    )


if __name__ == "__main__":
    main()

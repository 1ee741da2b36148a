"""What it costs to make messages of rows and terrain, and to read them.

Prints best wall times of many runs; serialisation is rclpy's own, for comparison. Run from the
repository root: `python benchmarks/message_codec.py`.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

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


def ms(work: Callable[[], object]) -> float:
    """Best wall time of one run [ms]."""
    work()
    return 1e3 * min(timeit.repeat(work, number=1, repeat=100))


def report(name: str, pack: Callable[[], Any], unpack: Callable[[Any], object]) -> None:
    """Print a line of the table."""
    msg = pack()
    wire = serialize_message(msg)
    times = (
        ms(pack),
        ms(lambda: serialize_message(msg)),
        ms(lambda: deserialize_message(wire, type(msg))),
        ms(lambda: unpack(msg)),
    )
    print(f"{name:<28}{len(wire):>10}" + "".join(f"{t:>13.3f}" for t in times))


def rows(count: int) -> Rows:
    """CONVERSION rows of random bytes."""
    raw = np.random.default_rng(1).integers(0, 256, (count, CONVERSION.itemsize), dtype=np.uint8)
    return raw.reshape(-1).view(CONVERSION)


def terrain(side: int) -> TerrainMap:
    """A map of random heights."""
    rng = np.random.default_rng(1)
    grid = Grid(side, side, 0.2)
    volume = rng.integers(0, 10**12, grid.shape)
    frame = Keyframe(1, 7, grid, rng.normal(size=grid.shape), volume)
    return TerrainMap(frame, rng.random(grid.shape))


def main() -> None:
    """Print the table."""
    header = SoilHeader(1, 1, 1, *(RowRange(1, 9),) * 3, (MachineReceipt(1, 1, 1, 1),) * 2)
    chunk = RowChunk(1, Stream.CONVERSION, 0, 0, rows(MAX_ROWS_PER_CHUNK))
    many, site = rows(100_000), terrain(513)
    print(f"{'ms':<28}{'bytes':>10}{'pack':>13}{'serialise':>13}{'deserialise':>13}{'unpack':>13}")
    report(
        "100000 conversion rows",
        lambda: to_point_cloud(many, "map", STAMP),
        lambda msg: from_point_cloud(msg, CONVERSION),
    )
    report(
        f"chunk of {MAX_ROWS_PER_CHUNK}",
        lambda: to_chunk_cloud(chunk, "map", STAMP),
        lambda msg: from_chunk_cloud(msg, Stream.CONVERSION),
    )
    report("513 x 513 keyframe", lambda: to_terrain_cloud(site, "map", STAMP), from_terrain_cloud)
    report("soil header, 2 machines", lambda: to_multi_array(header), from_multi_array)


if __name__ == "__main__":
    main()

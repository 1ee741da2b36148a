"""Figures of a recorded run, by which two runs are compared: volumes, cut and fill, cycles."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from earthmoving_sim.received_numbers import ReceivedNumbers
from earthmoving_sim.run_figures.payload_cycles import PayloadCycle, find_cycles
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import from_payload_array
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.stamps import seconds_from_stamp
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract import topics
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["RunFigures", "compare_figures", "read_figures"]

_CONVERSIONS = f"/{topics.SOIL_CONVERSIONS}"
_MAP_UPDATES = f"/{topics.TERRAIN_MAP_UPDATES}"
_MAP = f"/{topics.TERRAIN_MAP}"
_PAYLOAD = f"/{topics.PAYLOAD}"
_MM3 = 1e-9
"""Cubic metres in a cubic millimetre."""

_WIDTH = 34
"""Width of the column of names in a table."""


@dataclass
class RunFigures:
    """Figures of a run, volumes in m^3 bank.

    Attributes:
        excavated, deposited: sums of the conversion rows.
        cut, fill: sums over the columns that hold less, and more, at the end than at the begin.
        cycles: cycles of each machine with a payload, by the topic's namespace.
    """

    excavated: float = 0.0
    deposited: float = 0.0
    cut: float = 0.0
    fill: float = 0.0
    cycles: dict[str, list[PayloadCycle]] = field(default_factory=dict)


def read_figures(reader: BagReader, run_id: int, begin: float, end: float) -> RunFigures:
    """Return the figures of a run in a bag; those of topics that it lacks are 0.

    Args:
        reader: the bag.
        run_id: number of the run.
        begin, end: simulation times after which and up to which it counts [s].

    Raises:
        BagReadError: the bag is damaged.
    """
    volumes = _Volumes(run_id)
    payloads: dict[str, list[tuple[float, float]]] = defaultdict(list)
    wanted = [
        name
        for name in reader.topics
        if name in (_CONVERSIONS, _MAP_UPDATES, _MAP) or name.endswith(_PAYLOAD)
    ]
    present_run = None  # a payload does not name its run, and each run begins with a map
    for topic, _, message in reader.messages(wanted):
        with suppress(CodecError):  # a message of another program
            if topic == _MAP:
                present_run = volumes.add_map(message)
            elif topic.endswith(_PAYLOAD):
                state = from_payload_array(message)
                if present_run == run_id and begin < state.time_s <= end:
                    payloads[topic.removesuffix(_PAYLOAD)].append((state.time_s, state.bank_m3))
            elif (time := seconds_from_stamp(message.header.stamp)) <= end:
                is_conversion = topic == _CONVERSIONS
                stream = Stream.CONVERSION if is_conversion else Stream.MAP_UPDATE
                volumes.add_rows(from_chunk_cloud(message, stream), is_counted=time > begin)
    figures = volumes.figures()
    figures.cycles = {name: find_cycles(each) for name, each in payloads.items()}
    return figures


def compare_figures(recorded: RunFigures, other: RunFigures, title: str) -> list[str]:
    """Return the lines of a table that compares two runs.

    Args:
        recorded, other: the runs.
        title: heading of the second.
    """
    rows: list[tuple[str, float, float]] = [
        ("excavated [m3]", recorded.excavated, other.excavated),
        ("deposited [m3]", recorded.deposited, other.deposited),
        ("cut [m3]", recorded.cut, other.cut),
        ("fill [m3]", recorded.fill, other.fill),
    ]
    for name in recorded.cycles | other.cycles:
        before, now = recorded.cycles.get(name, []), other.cycles.get(name, [])
        if before or now:
            rows.append((f"{name}: cycles", len(before), len(now)))
            rows.append((f"{name}: volume per cycle [m3]", _volume(before), _volume(now)))
            rows.append((f"{name}: time of a cycle [s]", _duration(before), _duration(now)))
    lines = [f"  {'':<{_WIDTH}}{'recorded':>12}{title:>12}{'change':>10}"]
    for name, first, second in rows:
        change = f"{100.0 * (second / first - 1.0):+.1f} %" if first else ""
        lines.append(f"  {name:<{_WIDTH}}{first:>12.4g}{second:>12.4g}{change:>10}")
    return lines


def _volume(cycles: list[PayloadCycle]) -> float:
    return float(np.mean([each.volume for each in cycles])) if cycles else 0.0


def _duration(cycles: list[PayloadCycle]) -> float:
    return float(np.median([each.duration for each in cycles])) if cycles else 0.0


class _Volumes:
    """Sums of rows, and the volume of each column at begin and end."""

    def __init__(self, run_id: int) -> None:
        self._run_id = run_id
        self._sums: dict[int, int] = defaultdict(int)  # by kind [mm^3]
        self._received = ReceivedNumbers()  # of the conversions
        self._start: Any = None  # volume of each column [mm^3], shape (rows, cols)
        self._end: Any = None
        self._revisions: Any = None

    def add_map(self, message: Any) -> int:
        """Use the map if it is the first of the run; return the number of its run."""
        keyframe = from_terrain_cloud(message).keyframe
        if self._start is None and keyframe.run_id == self._run_id:
            self._start, self._end = keyframe.volume_mm3, keyframe.volume_mm3.copy()
            self._revisions = np.full(self._start.shape, keyframe.revision, dtype=np.int64)
        return keyframe.run_id

    def add_rows(self, chunk: RowChunk, *, is_counted: bool) -> None:
        """Add rows; repeated ones are ignored, and those before the begin only change its map."""
        if chunk.run_id != self._run_id:
            return
        rows = chunk.rows
        if chunk.stream is Stream.CONVERSION:
            rows = rows[self._received.add(rows["seq"].astype(np.int64))]
            for kind in np.unique(rows["kind"]) if is_counted else ():
                volumes = rows["volume_mm3"][rows["kind"] == kind]
                self._sums[int(kind)] += int(volumes.sum(dtype=np.int64))
        elif self._end is not None:
            at = rows["row"], rows["col"]
            is_newer = rows["revision"] >= self._revisions[at]
            at = at[0][is_newer], at[1][is_newer]
            self._end[at] = rows["volume_mm3"][is_newer].astype(np.int64)
            self._revisions[at] = rows["revision"][is_newer]
            if not is_counted:
                self._start[at] = self._end[at]

    def figures(self) -> RunFigures:
        """Return the figures of all rows."""
        figures = RunFigures(
            self._sums[ConversionKind.EXCAVATE] * _MM3, self._sums[ConversionKind.DEPOSIT] * _MM3
        )
        if self._end is not None:
            change = self._end - self._start
            figures.cut = float(-change[change < 0].sum()) * _MM3
            figures.fill = float(change[change > 0].sum()) * _MM3
        return figures

"""Compare a replay with its recording, tick by tick, and describe the first difference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, RowRange, SoilHeader, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["Difference", "describe_rows", "find_header_difference", "find_ledger_difference"]

_ROW_STREAMS = {
    "sweeps": Stream.SWEEP,
    "deposit_requests": Stream.DEPOSIT_REQUEST,
    "conversions": Stream.CONVERSION,
    "map_updates": Stream.MAP_UPDATE,
    "forces": Stream.FORCE,
}
"""Stream of the rows that a field of a header counts."""


_NO_ROWS = RowRange()


@dataclass(frozen=True)
class Difference:
    """A difference of a replay from its recording.

    Attributes:
        tick: tick in which it was found.
        where: `soil`, or the namespace of a machine node.
        text: what differs, with the recorded and the replayed value.
        stream: stream of the rows that differ; None if something else does.
        recorded_rows: numbers of the recorded rows of the tick in that stream.
    """

    tick: int
    where: str
    text: str
    stream: Stream | None = None
    recorded_rows: RowRange = _NO_ROWS

    def __str__(self) -> str:
        return f"tick {self.tick}, {self.where}: {self.text}"


def find_header_difference(
    recorded: SoilHeader | MachineHeader, replayed: SoilHeader | MachineHeader, where: str
) -> Difference | None:
    """Return the first field in which two headers differ; None if they are equal.

    Rows are compared by their numbers and digests.

    Args:
        recorded, replayed: the headers.
        where: as in `Difference`.
    """
    tick = recorded.tick
    for field in fields(recorded):
        before, now = getattr(recorded, field.name), getattr(replayed, field.name)
        if isinstance(before, RowRange):
            if (before, before.digest) == (now, now.digest):
                continue
            text = f"{field.name} are {before.count} rows recorded, {now.count} replayed"
            if before.count == now.count:
                text = f"the {before.count} rows of {field.name} have other values"
            return Difference(tick, where, text, _ROW_STREAMS[field.name], before)
        if before != now:
            return Difference(tick, where, f"{field.name} is {before} recorded, {now} replayed")
    return None


def find_ledger_difference(recorded: Ledger, replayed: Ledger) -> Difference | None:
    """Return the first account in which two ledgers differ; None if they are equal."""
    if recorded == replayed:
        return None
    for field in fields(recorded):
        before, now = getattr(recorded, field.name), getattr(replayed, field.name)
        if field.compare and before != now:
            text = f"the account {field.name} holds {before} mm3 recorded, {now} mm3 replayed"
            return Difference(recorded.tick, "soil", text)
    raise AssertionError("ledgers that differ have a field that differs")


def describe_rows(recorded: Rows, replayed: Rows) -> str:
    """Return the first row and field in which rows of one stream differ; empty if they are equal.

    Args:
        recorded, replayed: the rows of one tick, in order.
    """
    for k in range(min(recorded.size, replayed.size)):
        names = [
            name
            for name in recorded.dtype.names or ()
            if recorded[k][name].tobytes() != replayed[k][name].tobytes()
        ]
        if names:
            name = names[0]
            place = _place({each: recorded[k][each] for each in recorded.dtype.names or ()})
            return f"row {k + 1}{place}: {name} {recorded[k][name].item()} recorded, " + (
                f"{replayed[k][name].item()} replayed"
            )
    if recorded.size != replayed.size:
        return f"row {min(recorded.size, replayed.size) + 1} is in one of them only"
    return ""


def _place(row: Mapping[str, Any]) -> str:
    """Return what a row is about: a column of the terrain, a tool, or a particle."""
    if "row" in row:
        return f", column ({row['row']}, {row['col']})"
    if "tool" in row:
        return f", tool {row['tool']}"
    return f", particle {row['particle_id']}"

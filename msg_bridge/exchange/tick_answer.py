"""The soil's answer to a tick, as one machine applies it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from msg_bridge.contract.map_updates import map_updates_after
from msg_bridge.contract.messages import Message, RowChunk, SoilHeader, Stream
from msg_bridge.contract.rows import (
    CONVERSION,
    FORCE,
    MAP_UPDATE,
    Rows,
    empty_rows,
    rows_of_machine,
)
from msg_bridge.exchange.ticks_in_flight import CompletedTick

__all__ = ["TickAnswer"]


class TickAnswer(NamedTuple):
    """The soil's complete answer to a tick. The rows must not be modified.

    Attributes:
        tick: the soil's tick that answers; in real time it may be later than the tick sent.
        conversions: CONVERSION rows of this machine, in order.
        forces: FORCE rows of this machine.
        map_updates: MAP_UPDATE rows newer than the keyframe.
        header: the soil's header.
        all_rows: the rows of all machines, by stream.
    """

    tick: int
    conversions: Rows
    forces: Rows
    map_updates: Rows
    header: SoilHeader
    all_rows: Mapping[Stream, Rows]

    @classmethod
    def without_rows(cls, header: SoilHeader) -> TickAnswer:
        """Return the answer to the last tick of a session, after which no rows are received."""
        no_rows = empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE)
        return cls(header.tick, *no_rows, header, {})

    @property
    def messages(self) -> list[Message]:
        """The messages that it consists of: rows, then the header."""
        rows: list[Message] = [
            RowChunk(self.header.run_id, stream, 0, 0, each)
            for stream, each in self.all_rows.items()
            if each.size
        ]
        return [*rows, self.header]

    @classmethod
    def for_machine(
        cls, completed: CompletedTick, machine_id: int, keyframe_revision: int
    ) -> TickAnswer:
        """Return the rows that concern one machine.

        Args:
            completed: the rows of all machines.
            machine_id: number of the machine.
            keyframe_revision: revision of its keyframe, which contains older map updates.
        """
        rows = completed.rows
        return cls(
            completed.header.tick,
            rows_of_machine(rows[Stream.CONVERSION], machine_id),
            rows_of_machine(rows[Stream.FORCE], machine_id),
            map_updates_after(keyframe_revision, rows[Stream.MAP_UPDATE]),
            completed.header,
            rows,
        )

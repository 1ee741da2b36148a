"""Messages of the exchange as tuples of numbers and bytes, which pickle writes faster."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from msg_bridge.contract.messages import (
    STREAM_DTYPE,
    MachineHeader,
    MachineReceipt,
    Message,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)

__all__ = ["PackedMessage", "pack_messages", "unpack_messages"]

PackedMessage = tuple[Any, ...]
"""Kind of the message and its content."""

_CHUNK, _MACHINE, _SOIL, _OTHER = range(4)


def pack_messages(messages: Iterable[Message]) -> list[PackedMessage]:
    """Return messages in packed form, in order."""
    return [_pack(message) for message in messages]


def unpack_messages(packed: Iterable[PackedMessage]) -> list[Message]:
    """Return the messages of `pack_messages`."""
    return [_UNPACK[kind](*content) for kind, *content in packed]


def _pack(message: Message) -> PackedMessage:
    if isinstance(message, RowChunk):
        sender = message.machine_id, message.session_id
        return _CHUNK, message.run_id, int(message.stream), *sender, message.rows.tobytes()
    if isinstance(message, MachineHeader):
        return (
            _MACHINE,
            message.run_id,
            message.machine_id,
            message.session_id,
            message.tick,
            int(message.verb),
            _pack_range(message.sweeps),
            _pack_range(message.deposit_requests),
            message.conversions_received,
            message.pending_mm3,
            message.particles_mm3,
            message.previous_tick,
            message.answered_tick,
        )
    if isinstance(message, SoilHeader):
        return (
            _SOIL,
            message.run_id,
            message.tick,
            message.revision,
            _pack_range(message.conversions),
            _pack_range(message.map_updates),
            _pack_range(message.forces),
            [_pack_receipt(each) for each in message.receipts],
        )
    return _OTHER, message


def _pack_range(span: RowRange) -> tuple[int, int, int]:
    return span.first, span.count, span.digest


def _pack_receipt(receipt: MachineReceipt) -> tuple[int, ...]:
    return (
        receipt.machine_id,
        receipt.session_id,
        receipt.deposit_requests_received,
        receipt.backlog,
        receipt.tick,
        receipt.backlog_digest,
    )


def _unpack_chunk(
    run_id: int, stream: int, machine_id: int, session_id: int, content: bytes
) -> RowChunk:
    # Kernels are compiled for rows that may be written to: others would take a minute.
    rows = np.frombuffer(bytearray(content), dtype=STREAM_DTYPE[Stream(stream)])
    return RowChunk(run_id, Stream(stream), machine_id, session_id, rows)


def _unpack_machine_header(
    run_id: int,
    machine_id: int,
    session_id: int,
    tick: int,
    verb: int,
    sweeps: tuple[int, int, int],
    deposit_requests: tuple[int, int, int],
    *numbers: int,
) -> MachineHeader:
    spans = RowRange(*sweeps), RowRange(*deposit_requests)
    return MachineHeader(run_id, machine_id, session_id, tick, Verb(verb), *spans, *numbers)


def _unpack_soil_header(
    run_id: int,
    tick: int,
    revision: int,
    conversions: tuple[int, int, int],
    map_updates: tuple[int, int, int],
    forces: tuple[int, int, int],
    receipts: Iterable[tuple[int, ...]],
) -> SoilHeader:
    spans = RowRange(*conversions), RowRange(*map_updates), RowRange(*forces)
    return SoilHeader(
        run_id, tick, revision, *spans, tuple(MachineReceipt(*each) for each in receipts)
    )


_UNPACK: dict[int, Any] = {
    _CHUNK: _unpack_chunk,
    _MACHINE: _unpack_machine_header,
    _SOIL: _unpack_soil_header,
    _OTHER: lambda message: message,
}

"""Rows that a machine has sent in its session, kept until the soil has them."""

from __future__ import annotations

from typing import NamedTuple

from msg_bridge.contract.messages import (
    MachineHeader,
    MachineReceipt,
    Message,
    RetransmitRequest,
    RowRange,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.chunks import split_into_chunks
from msg_bridge.exchange.session_key import SessionKey
from msg_bridge.exchange.stream_buffers import SendBuffer

__all__ = ["MachineStreams", "SentRows"]


class SentRows(NamedTuple):
    """The rows of one tick.

    Attributes:
        sweeps: range of the SWEEP rows.
        deposit_requests: range of the DEPOSIT_REQUEST rows.
        chunks: the messages that carry them.
    """

    sweeps: RowRange
    deposit_requests: RowRange
    chunks: list[Message]


class MachineStreams:
    """The streams of sweeps and deposit requests of one session."""

    def __init__(self, key: SessionKey) -> None:
        """
        Args:
            key: the session.
        """
        self._key = key
        self._send_buffers = {
            stream: SendBuffer(stream, machine_id=key.machine_id)
            for stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST)
        }

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(buffer.num_buffered_rows for buffer in self._send_buffers.values())

    def append_tick(self, sweeps: Rows, deposit_requests: Rows) -> SentRows:
        """Number a copy of the rows of a tick, set their machine id, and keep them."""
        buffers = self._send_buffers
        sweeps, sweep_range = buffers[Stream.SWEEP].append(sweeps)
        deposit_requests, request_range = buffers[Stream.DEPOSIT_REQUEST].append(deposit_requests)
        chunks = self._chunks(Stream.SWEEP, sweeps)
        if deposit_requests.size:
            chunks += self._chunks(Stream.DEPOSIT_REQUEST, deposit_requests)
        return SentRows(sweep_range, request_range, chunks)

    def retransmit(self, request: RetransmitRequest) -> list[Message]:
        """Return the kept rows that a request names."""
        if request.stream not in self._send_buffers:
            return []
        wanted = RowRange(request.first, request.count)
        return self._chunks(request.stream, self._send_buffers[request.stream].kept_rows(wanted))

    def discard_answered(self, sent: MachineHeader, receipt: MachineReceipt | None) -> None:
        """Discard the rows that the soil has.

        Args:
            sent: header of a tick that is answered.
            receipt: the acknowledgement in the answer, if there is one.
        """
        self._send_buffers[Stream.SWEEP].discard_through(sent.sweeps.last)
        if receipt is not None:
            received = receipt.deposit_requests_received
            self._send_buffers[Stream.DEPOSIT_REQUEST].discard_through(received)

    def _chunks(self, stream: Stream, rows: Rows) -> list[Message]:
        run_id, machine_id, session_id = self._key
        return [
            *split_into_chunks(run_id, stream, rows, machine_id=machine_id, session_id=session_id)
        ]

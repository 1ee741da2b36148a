"""Rows that a machine has sent in its session, kept until the soil has them."""

from __future__ import annotations

from msg_bridge.contract.messages import (
    MachineHeader,
    MachineReceipt,
    Message,
    NumberedRows,
    RetransmitRequest,
    RowChunk,
    RowRange,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.chunks import sent_chunks, split_into_chunks
from msg_bridge.exchange.session_key import SessionKey
from msg_bridge.exchange.stream_buffers import SendBuffer

__all__ = ["MachineStreams"]


class MachineStreams:
    """The streams of sweeps and deposit requests of one session."""

    def __init__(self, key: SessionKey) -> None:
        """
        Args:
            key: the session.
        """
        self._key = key
        self._sweeps = SendBuffer(Stream.SWEEP, machine_id=key.machine_id)
        self._deposit_requests = SendBuffer(Stream.DEPOSIT_REQUEST, machine_id=key.machine_id)
        self._send_buffers = {
            Stream.SWEEP: self._sweeps,
            Stream.DEPOSIT_REQUEST: self._deposit_requests,
        }

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(buffer.num_buffered_rows for buffer in self._send_buffers.values())

    def append_tick(
        self, sweeps: Rows, deposit_requests: Rows
    ) -> tuple[RowRange, RowRange, list[Message]]:
        """Number a copy of the rows of a tick, set their machine id, and keep them.

        Returns:
            (range of the SWEEP rows, range of the DEPOSIT_REQUEST rows, messages that carry them).
        """
        chunks: list[Message] = []
        spans = []
        for buffer, rows in (
            (self._sweeps, sweeps),
            (self._deposit_requests, deposit_requests),
        ):
            sent = buffer.append(rows)
            spans.append(sent.span)
            if sent.span.count:
                chunks += self._sent_chunks(buffer.stream, sent)
        return spans[0], spans[1], chunks

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
        self._sweeps.discard_through(sent.sweeps.last)
        if receipt is not None:
            self._deposit_requests.discard_through(receipt.deposit_requests_received)

    def _sent_chunks(self, stream: Stream, sent: NumberedRows) -> list[RowChunk]:
        run_id, machine_id, session_id = self._key
        return sent_chunks(run_id, stream, sent, machine_id=machine_id, session_id=session_id)

    def _chunks(self, stream: Stream, rows: Rows) -> list[Message]:
        run_id, machine_id, session_id = self._key
        return [
            *split_into_chunks(run_id, stream, rows, machine_id=machine_id, session_id=session_id)
        ]

"""Rows that a machine has sent in its session, kept until the soil has them."""

from __future__ import annotations

from msg_bridge.contract.messages import Message, RetransmitRequest, RowRange, Stream
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.chunks import split_into_chunks
from msg_bridge.exchange.stream_buffers import SendBuffer

__all__ = ["MachineStreams"]


class MachineStreams:
    """The streams of sweeps and deposit requests of one session."""

    def __init__(self, run_id: int, machine_id: int, session_id: int) -> None:
        self._run_id = run_id
        self._machine_id = machine_id
        self._session_id = session_id
        self._send_buffers = {
            stream: SendBuffer(stream) for stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST)
        }

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(buffer.num_buffered_rows for buffer in self._send_buffers.values())

    def append(self, stream: Stream, rows: Rows) -> tuple[Rows, RowRange]:
        """Number a copy of some rows and set their machine id; return them and their range."""
        numbered, span = self._send_buffers[stream].append(rows)
        if numbered.size:
            numbered["machine_id"] = self._machine_id
        return numbered, span

    def chunks(self, stream: Stream, rows: Rows) -> list[Message]:
        """Return rows as messages."""
        return [
            *split_into_chunks(
                self._run_id,
                stream,
                rows,
                machine_id=self._machine_id,
                session_id=self._session_id,
            )
        ]

    def retransmit(self, request: RetransmitRequest) -> list[Message]:
        """Return the kept rows that a request names."""
        if request.stream not in self._send_buffers:
            return []
        wanted = RowRange(request.first, request.count)
        return self.chunks(request.stream, self._send_buffers[request.stream].kept_rows(wanted))

    def discard_through(self, stream: Stream, number: int) -> None:
        """Discard the rows of the ticks that end with row `number` or before."""
        self._send_buffers[stream].discard_through(number)

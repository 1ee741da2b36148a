"""Rows and headers that the soil has published, kept until all machines have them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping

from msg_bridge.contract.messages import (
    Message,
    NumberedRows,
    RetransmitRequest,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.chunks import sent_chunks, split_into_chunks
from msg_bridge.exchange.stream_buffers import SendBuffer

__all__ = ["SoilStreams"]

_MAX_KEPT_HEADERS = 64
"""Number of the latest headers that can be sent again."""

_STREAMS = (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.FORCE)
"""Streams that the soil sends to all, in the order in which they are posted."""


class SoilStreams:
    """The streams that the soil sends to all machines.

    Attributes:
        last_header: the latest header, None before the welcome.
    """

    def __init__(self, run_id: int) -> None:
        self.last_header: SoilHeader | None = None
        self._run_id = run_id
        self._send_buffers = {stream: SendBuffer(stream) for stream in _STREAMS}
        self._recent_headers: deque[SoilHeader] = deque(maxlen=_MAX_KEPT_HEADERS)

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(buffer.num_buffered_rows for buffer in self._send_buffers.values())

    def append(
        self, conversions: Rows, map_updates: Rows, forces: Rows
    ) -> tuple[NumberedRows, NumberedRows, NumberedRows]:
        """Number a copy of the rows of a tick, and keep them; return them in the same order."""
        buffers = self._send_buffers
        return (
            buffers[Stream.CONVERSION].append(conversions),
            buffers[Stream.MAP_UPDATE].append(map_updates),
            buffers[Stream.FORCE].append(forces),
        )

    def publish(self, header: SoilHeader, rows: Iterable[NumberedRows]) -> list[Message]:
        """Keep a header, and return the messages of its tick.

        The header comes last: over a transport that keeps the order its rows are there before it.

        Args:
            header: the header.
            rows: its rows, as returned by `append`.
        """
        self.last_header = header
        self._recent_headers.append(header)
        messages: list[Message] = []
        for stream, sent in zip(_STREAMS, rows, strict=True):
            if sent.span.count:
                messages += sent_chunks(self._run_id, stream, sent)
        messages.append(header)
        return messages

    def retransmit(self, request: RetransmitRequest) -> list[Message]:
        """Return the kept headers or rows that a request names.

        All headers from the requested one on are sent: a leaving machine needs any from its last
        tick on.
        """
        if request.stream is Stream.HEADER:
            return [header for header in self._recent_headers if header.tick >= request.first]
        if request.stream not in self._send_buffers:
            return []
        wanted = RowRange(request.first, request.count)
        rows = self._send_buffers[request.stream].kept_rows(wanted)
        return [*split_into_chunks(self._run_id, request.stream, rows)]

    def discard(
        self, acknowledged: Iterable[Mapping[Stream, RowRange]], last_conversion: int
    ) -> None:
        """Discard the rows that all machines have.

        Args:
            acknowledged: last ranges that each joined machine certainly has, by stream.
            last_conversion: last conversion row that every joined machine has applied.
        """
        spans = list(acknowledged)
        for stream, buffer in self._send_buffers.items():
            if not buffer.is_empty:
                last = (
                    last_conversion
                    if stream is Stream.CONVERSION
                    else min([each[stream].last for each in spans])
                )
                buffer.discard_through(last)

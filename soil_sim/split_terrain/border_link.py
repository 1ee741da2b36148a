"""Numbered rows from a region to its neighbour, over a channel that may lose them.

They are rows of the exchange: MAP_UPDATE rows keep the halo of the neighbour, and soil that slid
over the border is a DEPOSIT_REQUEST row, as soil of a particle that came to rest. Both are kept
until the neighbour has them, and are applied once and in order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from msg_bridge.contract.messages import RowRange, Stream
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.stream_buffers import ReceiveBuffer, SendBuffer

__all__ = ["BorderLink", "BorderRows", "Channel", "deliver"]

Channel = Callable[[Rows], Iterable[Rows]]
"""Returns the messages of rows that arrive when rows are sent: none, parts, repeated, in any
order."""

_STREAMS = (Stream.MAP_UPDATE, Stream.DEPOSIT_REQUEST)


class BorderRows(NamedTuple):
    """Rows that cross a border in a tick.

    Attributes:
        map_updates: MAP_UPDATE rows of the columns of the sender that changed.
        transfers: DEPOSIT_REQUEST rows of the soil that slid into columns of the receiver.
    """

    map_updates: Rows
    transfers: Rows


class BorderLink:
    """One direction of a border."""

    def __init__(self, sender_id: int, channel: Channel) -> None:
        """
        Args:
            sender_id: written into the transfers as id of their machine.
            channel: what arrives of the rows that are sent.
        """
        self._channel = channel
        self._sent = {
            Stream.MAP_UPDATE: SendBuffer(Stream.MAP_UPDATE),
            Stream.DEPOSIT_REQUEST: SendBuffer(Stream.DEPOSIT_REQUEST, machine_id=sender_id),
        }
        self._received = {stream: ReceiveBuffer(stream) for stream in _STREAMS}

    def transmit(self, rows: BorderRows) -> BorderRows:
        """Send the rows of a tick; return what the neighbour received, which is the same.

        What does not arrive is sent again.
        """
        received = []
        for stream, of_stream in zip(_STREAMS, rows, strict=True):
            sent = self._sent[stream].append(of_stream)
            self._receive(stream, sent.rows)
            while missing := self._received[stream].missing(sent.span):
                for gap in missing:
                    self._receive(stream, self._sent[stream].kept_rows(gap))
            received.append(self._take(stream, sent.span))
        return BorderRows(*received)

    def _receive(self, stream: Stream, rows: Rows) -> None:
        for message in self._channel(rows):
            self._received[stream].add(message)

    def _take(self, stream: Stream, span: RowRange) -> Rows:
        """Return the rows of a complete range, and discard them on both sides."""
        rows = self._received[stream].rows(span)
        self._received[stream].discard_through(span.last)
        self._sent[stream].discard_through(span.last)
        return rows


def deliver(rows: Rows) -> Iterable[Rows]:
    """Return the rows: a channel that loses nothing."""
    return (rows,)

"""What a machine receives between its join request and its first tick."""

from __future__ import annotations

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    Keyframe,
    MachineReceipt,
    Message,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.row_digest import check_row_digest
from msg_bridge.exchange.session_key import SessionKey
from msg_bridge.exchange.stream_buffers import ReceiveBuffer

__all__ = ["JoinHandshake"]


class JoinHandshake:
    """The welcome, a terrain not older than it, and the backlog, which arrive in any order.

    Attributes:
        welcome: the first header with a receipt of this machine.
        keyframe: the newest terrain received.
    """

    def __init__(self) -> None:
        self.welcome: SoilHeader | None = None
        self.keyframe: Keyframe | None = None
        self._backlog = ReceiveBuffer(Stream.BACKLOG)
        self._backlog_range = RowRange()

    @property
    def num_buffered_rows(self) -> int:
        """Number of backlog rows kept."""
        return self._backlog.num_buffered_rows

    @property
    def is_complete(self) -> bool:
        """Whether the machine can take part."""
        return self.welcome is not None and not self.missing()

    def set_welcome(self, header: SoilHeader, receipt: MachineReceipt) -> None:
        """Set the first header with a receipt of this machine; later ones are ignored."""
        if self.welcome is None:
            self.welcome = header
            self._backlog_range = RowRange(1, receipt.backlog, receipt.backlog_digest)

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """Keep a terrain if it is the newest."""
        if self.keyframe is None or keyframe.revision > self.keyframe.revision:
            self.keyframe = keyframe

    def add_backlog(self, rows: Rows) -> None:
        """Add rows of the backlog.

        Raises:
            ExchangeError: ROW_TYPE or SEQUENCE_NUMBER.
        """
        self._backlog.add(rows)

    def discard_content(self) -> None:
        """Discard terrain and backlog, so that they are requested again."""
        self.keyframe = None
        self._backlog.clear()

    def missing(self) -> list[tuple[Stream, RowRange]]:
        """Return what to request again; nothing before the welcome, which counts the backlog."""
        if self.welcome is None:
            return []
        missing = [(Stream.BACKLOG, gap) for gap in self._backlog.missing(self._backlog_range)]
        if self.keyframe is None or self.keyframe.revision < self.welcome.revision:
            missing.append((Stream.KEYFRAME, RowRange(0, 1)))
        return missing

    def messages(self, key: SessionKey) -> list[Message]:
        """Return the messages of a handshake that is complete."""
        assert self.welcome is not None
        assert self.keyframe is not None
        backlog = RowChunk(
            self.welcome.run_id,
            Stream.BACKLOG,
            key.machine_id,
            key.session_id,
            self._backlog.rows(self._backlog_range),
        )
        return [self.welcome, backlog, self.keyframe]

    def backlog_rows(self) -> Rows:
        """Return the backlog, in order.

        Raises:
            ExchangeError: ROW_DIGEST: it is not the backlog that the welcome states; it was
                discarded.
        """
        rows = self._backlog.rows(self._backlog_range)
        try:
            check_row_digest(rows, self._backlog_range, Stream.BACKLOG)
        except ExchangeError:
            self._backlog.clear()
            raise
        return rows

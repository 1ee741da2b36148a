"""Entering: what a machine gathers between asking to join and its first tick."""

from __future__ import annotations

from msg_bridge.contract.messages import (
    Keyframe,
    MachineReceipt,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.stream_buffers import ReceiveBuffer

__all__ = ["JoinHandshake"]


class JoinHandshake:
    """The welcome, a terrain that is not older, and the rows owed from before a return.

    They come in any order.

    Attributes:
        welcome: the first header that lists this machine.
        keyframe: the newest terrain heard of.
        owed: conversion rows owed, numbered from 1.
    """

    def __init__(self) -> None:
        self.welcome: SoilHeader | None = None
        self.keyframe: Keyframe | None = None
        self.backlog = ReceiveBuffer(Stream.BACKLOG)
        self._backlog_range = RowRange()

    def take_welcome(self, header: SoilHeader, receipt: MachineReceipt) -> None:
        """Take the first header that lists this machine; later ones tell nothing new."""
        if self.welcome is None:
            self.welcome = header
            self._backlog_range = RowRange(1, receipt.backlog)

    def take_keyframe(self, keyframe: Keyframe) -> None:
        """Take a terrain, if it is the newest so far."""
        if self.keyframe is None or keyframe.revision > self.keyframe.revision:
            self.keyframe = keyframe

    def missing(self) -> list[tuple[Stream, RowRange]]:
        """What to ask for again, once welcome."""
        assert self.welcome is not None
        asks = [(Stream.BACKLOG, gap) for gap in self.backlog.missing(self._backlog_range)]
        if self.keyframe is None or self.keyframe.revision < self.welcome.revision:
            asks.append((Stream.KEYFRAME, RowRange(0, 1)))
        return asks

    @property
    def is_complete(self) -> bool:
        """Whether the machine can take part."""
        return self.welcome is not None and not self.missing()

    def backlog_rows(self) -> Rows:
        """The rows it is owed, in order."""
        return self.backlog.rows(self._backlog_range)

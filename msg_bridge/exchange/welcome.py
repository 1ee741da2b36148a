"""What the soil sends to an admitted machine besides the header: the terrain and the backlog."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import (
    Keyframe,
    KeyframeDue,
    Message,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.exchange.chunks import split_into_chunks
from msg_bridge.exchange.machine_session import MachineSession

__all__ = ["Layers", "Welcome"]

Layers = tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]
"""`volume_mm3`, `soil`, `moisture` and `rut_depth` of a `Keyframe`."""


class Welcome:
    """Keyframes of the present terrain, and the backlogs of rejoining machines."""

    def __init__(
        self,
        grid: Grid,
        elevation: Callable[[], NDArray[np.float64]],
        layers: Callable[[], Layers] | None = None,
        *,
        by_transport: bool = False,
    ) -> None:
        """
        Args:
            grid: the grid of the terrain.
            elevation: returns the present elevation [m], shape (rows, cols).
            layers: returns the present `Layers`; None: zeros.
            by_transport: whether the transport sends the terrain in its own way: it gets
                `KeyframeDue` instead of a copy, which takes long for large terrain.
        """
        self._grid = grid
        self._elevation = elevation
        self._layers = layers
        self._by_transport = by_transport

    def messages(self, header: SoilHeader, sessions: Iterable[MachineSession]) -> list[Message]:
        """Return one keyframe and the backlog of each session; none without sessions.

        Args:
            header: the latest header of the soil.
            sessions: the admitted sessions.
        """
        messages: list[Message] = []
        for session in sessions:
            messages = messages or [self._keyframe(header)]
            wanted = RowRange(1, session.num_backlog_rows)
            messages += self._backlog(header.run_id, session, wanted)
        return messages

    def retransmit(
        self, request: RetransmitRequest, session: MachineSession, header: SoilHeader
    ) -> list[Message]:
        """Return what a machine requests: the terrain, or rows of its backlog.

        Args:
            request: the request, for KEYFRAME or BACKLOG.
            session: session of the machine.
            header: the latest header of the soil.
        """
        if request.stream is Stream.KEYFRAME:
            return [self._keyframe(header)]
        wanted = RowRange(request.first, request.count)
        return [*self._backlog(request.run_id, session, wanted)]

    def _keyframe(self, header: SoilHeader) -> Keyframe | KeyframeDue:
        """Return a copy of the present terrain, that of the latest header, or that it is due."""
        if self._by_transport:
            return KeyframeDue(header.run_id, header.revision)
        layers = () if self._layers is None else self._layers()
        elevation = self._elevation().copy()
        return Keyframe(header.run_id, header.revision, self._grid, elevation, *layers)

    def _backlog(self, run_id: int, session: MachineSession, wanted: RowRange) -> list[RowChunk]:
        """Return backlog rows of a session that are still kept."""
        return split_into_chunks(
            run_id,
            Stream.BACKLOG,
            session.backlog.kept_rows(wanted),
            machine_id=session.machine_id,
            session_id=session.session_id,
        )

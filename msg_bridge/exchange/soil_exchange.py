"""The soil's end of the exchange: the barrier of the tick and the keeper of the ledger.

A state machine without a clock or a network, as `machine_side`. The soil calls `poll` until a tick
is complete, works on its rows, and gives what it moved to `answer`, which numbers the rows, books
them and posts them to all machines::

    expected sources join -> answer 0 (welcome) -> poll: tick 1 complete -> answer 1 -> ...

In lockstep a tick is complete with every machine's part. A machine may have sent the next one
already (`AHEAD`), whose turn comes after. In real time the soil may go on without
a late machine, whose part then counts in a later tick: its receipt tells it which.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    MachineHeader,
    Message,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows, join_rows
from msg_bridge.exchange.chunks import split_into_chunks
from msg_bridge.exchange.machine_session import MachineSession
from msg_bridge.exchange.soil_accounts import SoilAccounts
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH, SendBuffer

__all__ = ["SoilExchange", "TickInput"]

_MAX_MACHINE_ID, _MAX_SESSION_ID = 2**16 - 1, 2**32 - 1
"""What fits the fields of rows."""

_MAX_KEPT_HEADERS = 64
"""Headers that can be said again."""


@dataclass(frozen=True)
class TickInput:
    """Everything the machines sent for one tick; its rows are not to be written to.

    Attributes:
        tick: its number; 0 is the welcome, before anything has moved.
        sweeps: SWEEP rows, by source and seq.
        landed: LANDED rows, by source and seq.
    """

    tick: int
    sweeps: Rows
    deposit_requests: Rows


Layers = tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]


class SoilExchange:
    """Numbered streams to all machines, receipts from each, and the accounts.

    Attributes:
        epoch: raised by every reset.
        tick: the last tick answered; -1 before the welcome.
        ledger: of the last tick answered, None before the welcome.
        accounts: soil that is not terrain.
        refused: why the latest join of a source was refused, by source.
    """

    def __init__(
        self,
        grid: Grid,
        elevation: Callable[[], NDArray[np.float64]],
        *,
        layers: Callable[[], Layers] | None = None,
        expected: Iterable[int] = (1,),
        run_id: int = 1,
    ) -> None:
        """
        Args:
            grid: of the terrain.
            elevation: gives the surface as it is now [m], shape (rows, cols).
            layers: gives what it is of: `volume_mm3`, `soil` and `moisture` of a `Keyframe`.
            expected: sources without which tick 1 does not begin.
            epoch: number of this run.
        """
        self.run_id = run_id
        self.tick = -1
        self.ledger: Ledger | None = None
        self.accounts = SoilAccounts()
        self.rejected_joins: dict[int, JoinRejected] = {}
        self._grid = grid
        self._elevation = elevation
        self._layers = layers
        self._expected = frozenset(expected)
        self._sessions: dict[int, MachineSession] = {}
        self._joining: dict[int, MachineHeader] = {}
        self._latest_session_ids: dict[int, int] = {}
        self._send_buffers = {
            s: SendBuffer(s) for s in (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.FORCE)
        }
        self._last_header: SoilHeader | None = None
        self._recent_headers: deque[SoilHeader] = deque(maxlen=_MAX_KEPT_HEADERS)
        self._machines_in_tick: tuple[
            int, ...
        ] = ()  # sources whose part is in the tick that was polled
        self._outbox: list[Message] = []

    @property
    def joined(self) -> tuple[int, ...]:
        """Sources that take part, in order."""
        return tuple(sorted(self._sessions))

    @property
    def late(self) -> tuple[int, ...]:
        """Sources whose tick the soil is waiting for."""
        return tuple(n for n in self.joined if not self._sessions[n].is_complete())

    @property
    def releasable_machines(self) -> tuple[int, ...]:
        """Absent sources whose soil can be released: those that are not about to come back."""
        return tuple(n for n in self.accounts.absent if n not in self._joining)

    @property
    def is_missing_rows(self) -> bool:
        """Whether a machine's header is here and rows that it counts are not."""
        return any(self._sessions[n].header is not None for n in self.late)

    def receive(self, message: Message) -> None:
        """Take one message from a machine; those of another epoch or life are ignored.

        Raises:
            ExchangeError: it breaks the exchange; nothing was changed.
        """
        if message.run_id != self.run_id:
            return
        if isinstance(message, MachineHeader):
            if message.verb in (Verb.JOIN, Verb.REJOIN):
                self._receive_join_request(message)
            elif message.tick <= self.tick + 1 + PIPELINE_DEPTH:
                machine_id = self._current_session(message.machine_id, message.session_id)
                if machine_id is not None:
                    machine_id.take_header(message)
        elif isinstance(message, RowChunk):
            machine_id = self._current_session(message.machine_id, message.session_id)
            if machine_id is not None:
                machine_id.take_rows(message)
        elif isinstance(message, RetransmitRequest):
            self._retransmit(message)

    def poll(self, *, wait: bool = True) -> TickInput | None:
        """The next tick, once every joined source's part of it is here.

        Tick 0, without rows, comes once all expected sources have asked to join.

        Args:
            wait: for late sources, and for a first one. If not, the tick has the parts that are
                here; a late one counts in the tick that is polled once it has come.
        """
        if self.tick < 0:
            if not self._expected <= set(self._joining):
                return None
            return TickInput(0, empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST))
        late = self.late
        if wait and (late or not (self._sessions or self._joining)):
            return None
        self._machines_in_tick = tuple(n for n in self.joined if n not in late)
        sweeps, deposit_requests = [], []
        for number in self._machines_in_tick:
            machine_id = self._sessions[number]
            assert machine_id.header is not None
            sweeps.append(machine_id.sweeps.rows(machine_id.header.sweeps))
            deposit_requests.append(
                machine_id.deposit_requests.rows(machine_id.header.deposit_requests)
            )
        return TickInput(
            self.tick + 1, join_rows(sweeps, SWEEP), join_rows(deposit_requests, DEPOSIT_REQUEST)
        )

    def answer(
        self, conversions: Rows, forces: Rows, map_updates: Rows, *, revision: int, terrain_mm3: int
    ) -> Ledger:
        """Number, book and post what the soil moved in the polled tick, and begin the next.

        Args:
            conversions, forces, changed: rows of those types, `seq` not yet given.
            revision: of the terrain after the tick.
            terrain_mm3: the terrain's own count.

        Returns:
            The ledger of the tick.

        Raises:
            ExchangeError: conversions for a source that takes no part; nothing was changed.
        """
        self.accounts.check(conversions)
        self.tick += 1
        conversions, conversion_range = self._send_buffers[Stream.CONVERSION].append(conversions)
        map_updates, map_update_range = self._send_buffers[Stream.MAP_UPDATE].append(map_updates)
        forces, force_range = self._send_buffers[Stream.FORCE].append(forces)
        self.accounts.add_in_flight(conversion_range, conversions)
        for number in self._machines_in_tick:
            self._finish(self._sessions[number])
        self._machines_in_tick = ()
        admitted = self._admit_joining(conversion_range.last)
        header = SoilHeader(
            self.run_id,
            self.tick,
            revision,
            conversions=conversion_range,
            map_updates=map_update_range,
            forces=force_range,
            receipts=tuple(self._sessions[n].receipt for n in self.joined),
        )
        for machine_id in self._sessions.values():
            machine_id.record_published(header)
        self._last_header = header
        self._recent_headers.append(header)
        # The header last: who has it can expect to have the rows.
        self._post(Stream.CONVERSION, conversions)
        self._post(Stream.MAP_UPDATE, map_updates)
        self._post(Stream.FORCE, forces)
        self._outbox.append(header)
        self._welcome(admitted)
        self._discard_acknowledged(header)
        self.ledger = self.accounts.ledger(self.run_id, self.tick, terrain_mm3)
        return self.ledger

    def drop(self, machine_id: int) -> None:
        """Go on without a joined source that has fallen silent; what it holds is absent now.

        It notices by the next header, and may come back with what it holds.

        Raises:
            ExchangeError: it takes no part.
        """
        if machine_id not in self._sessions:
            raise ExchangeError(f"machine {machine_id} takes no part; it cannot be dropped")
        self.accounts.leave(machine_id)
        del self._sessions[machine_id]

    def release(self, machine_id: int) -> int:
        """Take over what an absent source held [mm^3]; it cannot come back with it any more.

        The next `answer` must have DEPOSIT or OUTSIDE rows of this source over all of it.

        Raises:
            ExchangeError: it takes part, or is waiting to come back.
        """
        if machine_id in self._sessions or machine_id in self._joining:
            raise ExchangeError(
                f"machine {machine_id} takes part; what it holds can be released once it has left"
            )
        return self.accounts.release(machine_id)

    def request_missing(self) -> None:
        """Ask again for what has not come, and say again where the run stands."""
        if self._last_header is not None:
            self._outbox.append(self._last_header)
        for number in self.late:
            machine_id = self._sessions[number]
            if machine_id.header is None:
                missing = [(Stream.HEADER, RowRange(self.tick + 1, 1))]
            else:
                missing = machine_id.gaps()
            for stream, gap in missing:
                self._outbox.append(
                    RetransmitRequest(
                        self.run_id, number, machine_id.session_id, stream, gap.first, gap.count
                    )
                )

    def drain_outbox(self) -> list[Message]:
        """The messages to carry to all machines, in order; empties the box."""
        out, self._outbox = self._outbox, []
        return out

    def _current_session(self, number: int, session_id: int) -> MachineSession | None:
        machine_id = self._sessions.get(number)
        return (
            machine_id if machine_id is not None and machine_id.session_id == session_id else None
        )

    def _receive_join_request(self, header: MachineHeader) -> None:
        number, session_id = header.machine_id, header.session_id
        if not (1 <= number <= _MAX_MACHINE_ID and 1 <= session_id <= _MAX_SESSION_ID):
            raise ExchangeError(
                f"source {number} asks to join in life {session_id}; give it a source from 1 to"
                f" {_MAX_MACHINE_ID} and a life from 1 to {_MAX_SESSION_ID}"
            )
        if self._current_session(number, session_id) is not None:
            if self._last_header is not None:  # its welcome was lost
                self._outbox.append(self._last_header)
                self._welcome([number])
        elif session_id > self._latest_session_ids.get(number, 0):
            if number in self._sessions:
                # Its former life ended without a word.
                self.accounts.leave(number)
                del self._sessions[number]
            self._joining[number] = header
            self._latest_session_ids[number] = session_id
        elif number in self.rejected_joins and self.rejected_joins[number].session_id == session_id:
            self._outbox.append(self.rejected_joins[number])
        elif session_id < self._latest_session_ids.get(number, 0) or number not in self._joining:
            reason = (
                f"source {number} has had life {self._latest_session_ids.get(number, 0)}; join anew"
            )
            self._outbox.append(JoinRejected(self.run_id, number, session_id, reason))

    def _finish(self, machine_id: MachineSession) -> None:
        """Close the tick of one source: its totals, its acknowledgement, its rows."""
        header = machine_id.complete_tick()
        self.accounts.update_totals(header)
        if header.verb is Verb.LEAVE:
            self.accounts.leave(header.machine_id)
            del self._sessions[header.machine_id]

    def _admit_joining(self, published: int) -> list[int]:
        """Let waiting sources in, as of this tick; returns their numbers.

        Args:
            published: last conversion row published so far.
        """
        admitted = []
        for number, header in sorted(self._joining.items()):
            try:
                if header.verb is Verb.REJOIN:
                    self.accounts.rejoin(header, published)
                else:
                    self.accounts.join(number, published)
            except ExchangeError as error:
                rejection = JoinRejected(self.run_id, number, header.session_id, str(error))
                self.rejected_joins[number] = rejection
                self._outbox.append(rejection)
                continue
            self.rejected_joins.pop(number, None)
            backlog = self.accounts.backlog(number)
            self._sessions[number] = MachineSession(number, header.session_id, backlog, self.tick)
            admitted.append(number)
        self._joining.clear()
        return admitted

    def _discard_acknowledged(self, answered: SoilHeader) -> None:
        """Forget rows that every source has; conversions once they are applied."""
        has = [machine_id.acknowledged for machine_id in self._sessions.values()] or [
            answered.spans
        ]
        for stream in (Stream.MAP_UPDATE, Stream.FORCE):
            self._send_buffers[stream].discard_through(min(spans[stream].last for spans in has))
        self._send_buffers[Stream.CONVERSION].discard_through(
            self.accounts.last_row_acknowledged_by_all
        )

    def _welcome(self, numbers: list[int]) -> None:
        """Post the terrain, and the rows each is owed."""
        if numbers:
            self._outbox.append(self._keyframe())
        for number in numbers:
            machine_id = self._sessions[number]
            self._post_backlog(machine_id, RowRange(1, machine_id.num_backlog_rows))

    def _post_backlog(self, machine_id: MachineSession, wanted: RowRange) -> None:
        rows = machine_id.backlog.kept_rows(wanted)
        self._outbox.extend(
            split_into_chunks(
                self.run_id,
                Stream.BACKLOG,
                rows,
                machine_id=machine_id.machine_id,
                session_id=machine_id.session_id,
            )
        )

    def _keyframe(self) -> Keyframe:
        assert self._last_header is not None
        layers = () if self._layers is None else self._layers()
        surface = self._elevation().copy()
        return Keyframe(self.run_id, self._last_header.revision, self._grid, surface, *layers)

    def _retransmit(self, request: RetransmitRequest) -> None:
        if self._last_header is None:
            return
        wanted = RowRange(request.first, request.count)
        if request.stream is Stream.HEADER:
            # A machine that leaves is content with any header from its last tick on.
            self._outbox.extend(said for said in self._recent_headers if said.tick >= request.first)
        elif (
            machine_id := self._current_session(request.machine_id, request.session_id)
        ) is not None:
            if request.stream is Stream.KEYFRAME:
                self._outbox.append(self._keyframe())
            elif request.stream is Stream.BACKLOG:
                self._post_backlog(machine_id, wanted)
            elif request.stream in self._send_buffers:
                self._post(request.stream, self._send_buffers[request.stream].kept_rows(wanted))

    def _post(self, stream: Stream, rows: Rows) -> None:
        """Post rows to all."""
        self._outbox.extend(split_into_chunks(self.run_id, stream, rows))

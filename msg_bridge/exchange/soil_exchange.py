"""The soil's end of the exchange: the barrier at the end of each tick, and the ledger.

A state machine without clock and network, as `machine_exchange`. The soil calls `poll` until a tick
is complete, processes its rows, and passes what it moved to `answer`, which numbers, accounts and
publishes the rows::

    expected machines join -> answer 0 (welcome) -> poll: tick 1 complete -> answer 1 -> ...

In lockstep a tick is complete when the part of every joined machine is here. A machine may have
sent its next tick already (`PIPELINE_DEPTH`), which waits. In real time the soil may continue
without a late machine, whose part then belongs to a later tick: its receipt states which.
"""

from __future__ import annotations

from collections.abc import Iterable

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    MachineHeader,
    Message,
    RetransmitRequest,
    RowChunk,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows, join_rows
from msg_bridge.exchange.join_admission import JoinAdmission
from msg_bridge.exchange.joined_machines import JoinedMachines
from msg_bridge.exchange.ledger_accounts import LedgerAccounts
from msg_bridge.exchange.machine_session import MachineSession
from msg_bridge.exchange.session_key import SessionKey
from msg_bridge.exchange.soil_streams import SoilStreams
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH
from msg_bridge.exchange.tick_input import TickInput
from msg_bridge.exchange.welcome import Welcome

__all__ = ["SoilExchange"]


class SoilExchange:
    """The sessions of all machines, the published streams, and the accounts.

    Attributes:
        run_id: number of the run.
        tick: the last tick answered; -1 before the welcome.
        ledger: ledger of that tick, None before the welcome.
        accounts: soil that is not terrain.
    """

    def __init__(
        self,
        welcome: Welcome,
        *,
        expected: Iterable[int] = (1,),
        admit_others: bool = False,
        run_id: int = 1,
    ) -> None:
        """
        Args:
            welcome: what an admitted machine receives.
            expected: ids of the machines that must join before tick 1.
            admit_others: whether machines with other ids may join, too.
            run_id: number of the run.
        """
        self.run_id = run_id
        self.tick = -1
        self.ledger: Ledger | None = None
        self.accounts = LedgerAccounts()
        self._welcome = welcome
        self._expected = frozenset(expected)
        self._admission = JoinAdmission(run_id, None if admit_others else self._expected)
        self._machines = JoinedMachines()
        self._streams = SoilStreams(run_id)
        self._machines_in_tick: tuple[int, ...] = ()  # whose part is in the polled tick
        self._outbox: list[Message] = []

    @property
    def joined(self) -> tuple[int, ...]:
        """Ids of the machines that take part, ascending."""
        return self._machines.ids

    @property
    def session_ids(self) -> dict[int, int]:
        """Session of each machine that takes part, by machine id."""
        return {session.machine_id: session.session_id for session in self._machines}

    @property
    def late(self) -> tuple[int, ...]:
        """Ids of the machines whose part of the next tick is incomplete, ascending."""
        return self._machines.late

    @property
    def releasable_machines(self) -> tuple[int, ...]:
        """Ids of the absent machines whose soil can be released, ascending; not the rejoining."""
        return tuple(n for n in self.accounts.absent if n not in self._admission.rejoining)

    @property
    def machines_with_ended_accounts(self) -> tuple[int, ...]:
        """Ids of machines whose ended accounts can be released, ascending; not the rejoining."""
        ended = self.accounts.machines_with_ended_accounts
        return tuple(n for n in ended if n not in self._admission.rejoining)

    @property
    def awaited_machines(self) -> tuple[int, ...]:
        """Ids of the expected machines without which tick 0 does not come, ascending."""
        return () if self.tick >= 0 else tuple(sorted(self._expected - self._admission.waiting))

    def is_missing_rows_of(self, machine_id: int) -> bool:
        """Return whether the header of a joined machine is here and rows that it counts are not."""
        return machine_id in self.late and self._machines[machine_id].header is not None

    @property
    def contending_requests(self) -> dict[int, int]:
        """Number of requests of other sessions to join as a machine during its present session, by
        machine id; see `JoinAdmission`."""
        return self._admission.contending_requests

    @property
    def is_missing_rows(self) -> bool:
        """Whether the header of a late machine is here and rows that it counts are not."""
        return self._machines.is_missing_rows

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows in memory, published and received."""
        return self._machines.num_buffered_rows + self._streams.num_buffered_rows

    def receive(self, message: Message) -> bool:
        """Process one message of a machine; those of another run or session are ignored.

        Returns:
            Whether it is one that its machine can send now in the session in which it takes part:
            the machine is alive, unless another publisher repeats its last messages.

        Raises:
            ExchangeError: it violates the protocol; nothing was changed.
        """
        if message.run_id != self.run_id:
            return False
        if isinstance(message, RowChunk):
            session = self._machines.session(message.machine_id, message.session_id)
            return session is not None and session.receive_rows(message)
        if not isinstance(message, MachineHeader | RetransmitRequest):
            return False
        session = self._machines.session(message.machine_id, message.session_id)
        if isinstance(message, RetransmitRequest):
            self._retransmit(message, session)
        elif not message.is_tick:
            self._receive_join_request(message, session)
        elif session is not None:
            self._receive_tick(session, message)
        return session is not None and session.can_send(message)

    def poll(self, *, wait: bool = True) -> TickInput | None:
        """Return the next tick once the part of every joined machine is here, else None.

        Tick 0, without rows, is returned once all expected machines have requested to join.

        Args:
            wait: whether to wait for late machines, and for a first machine. If not, the tick
                contains the parts that are here; a late part belongs to the tick polled after it
                has arrived.

        Raises:
            ExchangeError: rows of a machine are invalid; they were discarded, and
                `request_missing` requests them again. ROW_DIGEST: they are not those that their
                header states; DEPOSIT_VOLUME: it requests to deposit soil that it does not hold.
        """
        if self.tick < 0:
            if not self._expected <= self._admission.waiting:
                return None
            return TickInput(0, empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST))
        in_tick, num_joined = self._machines.complete, len(self._machines)
        is_late = len(in_tick) < num_joined
        if wait and (is_late or not (num_joined or self._admission.waiting)):
            return None
        parts = [self._checked_rows(self._machines[machine_id]) for machine_id in in_tick]
        self._machines_in_tick = in_tick
        return TickInput(
            self.tick + 1,
            join_rows([sweeps for sweeps, _ in parts], SWEEP),
            join_rows([requests for _, requests in parts], DEPOSIT_REQUEST),
        )

    def polled_messages(self) -> list[Message]:
        """Return the messages with which an exchange in this state polls the same tick: requests
        to join, and rows and headers. Call it after `poll` and before `answer`."""
        messages: list[Message] = list(self._admission.requests)
        for machine_id in self._machines_in_tick:
            messages += self._machines[machine_id].tick_messages()
        return messages

    def discard_unprocessed(self) -> None:
        """Discard what the machines have sent of later ticks; it is requested again."""
        self._machines.discard_unprocessed()

    @property
    def last_header(self) -> SoilHeader | None:
        """Header of the last tick answered; None before the welcome."""
        return self._streams.last_header

    def answer(
        self, conversions: Rows, forces: Rows, map_updates: Rows, *, revision: int, terrain_mm3: int
    ) -> Ledger:
        """Number, account and publish what the soil moved in the polled tick; begin the next.

        Args:
            conversions, forces, map_updates: rows of those types, `seq` not yet set.
            revision: revision of the terrain after the tick.
            terrain_mm3: volume of the terrain, counted by the soil [mm^3].

        Returns:
            The ledger of the tick.

        Raises:
            ExchangeError: NOT_JOINED: a row of a machine that takes no part; RELEASE: released soil
                is not deposited in full. Nothing was changed.
        """
        self.accounts.check(conversions)
        self.tick += 1
        sent = self._streams.append(conversions, map_updates, forces)
        sent_conversions, sent_updates, sent_forces = sent
        conversion_range = sent_conversions.span
        self.accounts.add_in_flight(conversion_range, sent_conversions.rows)
        for machine_id in self._machines_in_tick:
            self._complete_tick(machine_id)
        self._machines_in_tick = ()
        admitted = self._admit(conversion_range.last)
        header = SoilHeader(
            self.run_id,
            self.tick,
            revision,
            conversions=conversion_range,
            map_updates=sent_updates.span,
            forces=sent_forces.span,
            receipts=self._machines.receipts,
        )
        self._machines.record_published(header)
        self._outbox += self._streams.publish(header, sent)
        if admitted:
            self._outbox += self._welcome.messages(header, admitted)
        self._streams.discard(
            self._machines.acknowledged or [header.spans],
            self.accounts.last_row_acknowledged_by_all,
        )
        self.ledger = self.accounts.ledger(self.run_id, self.tick, terrain_mm3)
        return self.ledger

    def drop(self, machine_id: int) -> None:
        """Continue without a joined machine that is silent; the soil it holds is absent now.

        The next header has no receipt for the machine, which may rejoin with the soil it holds.

        Raises:
            ExchangeError: NOT_JOINED.
        """
        if machine_id not in self._machines:
            raise ExchangeError(
                f"machine {machine_id} takes no part; only a joined machine can be dropped",
                ErrorCode.NOT_JOINED,
            )
        self._end_session(machine_id)

    def release(self, machine_id: int) -> dict[int, int]:
        """Take over the soil of an absent machine, which cannot rejoin with it any more.

        The next `answer` must contain DEPOSIT or OUTSIDE rows of this machine for all of it.

        Returns:
            Volume by number of the account that held it [mm^3]; see `LedgerAccounts`.

        Raises:
            ExchangeError: STILL_JOINED: it takes part, or waits to rejoin.
        """
        if machine_id in self._machines or machine_id in self._admission.rejoining:
            raise ExchangeError(
                f"machine {machine_id} takes part; release its soil after it has left",
                ErrorCode.STILL_JOINED,
            )
        return self.accounts.release(machine_id)

    def release_ended(self, machine_id: int) -> dict[int, int]:
        """Take over the soil of the ended accounts of a machine.

        The next `answer` must contain DEPOSIT or OUTSIDE rows with the machine id `ENDED_SESSION`
        for all of it.

        Returns:
            As `release`.
        """
        return self.accounts.release_ended(machine_id)

    def request_missing(self) -> None:
        """Request what has not arrived, and send the latest header again."""
        if self._streams.last_header is not None:
            self._outbox.append(self._streams.last_header)
        self._outbox += self._machines.missing(self.run_id, self.tick + 1)

    def drain_outbox(self) -> list[Message]:
        """Return the messages to send to all machines, in order, and empty the outbox."""
        out, self._outbox = self._outbox, []
        return out

    def _receive_join_request(self, header: MachineHeader, session: MachineSession | None) -> None:
        """Add a request to join; repeat the welcome of a session that has begun.

        Raises:
            ExchangeError: ID_RANGE.
        """
        SessionKey(self.run_id, header.machine_id, header.session_id).check()
        if session is not None:
            last_header = self._streams.last_header
            if last_header is not None:  # its welcome was lost
                self._outbox += [last_header, *self._welcome.messages(last_header, [session])]
            return
        is_joined = header.machine_id in self._machines
        rejection = self._admission.add(header, is_joined=is_joined)
        if rejection is not None:
            self._outbox.append(rejection)

    def _receive_tick(self, session: MachineSession, header: MachineHeader) -> None:
        """Add the header of a machine's next tick; duplicates, and later ones, are ignored.

        Raises:
            ExchangeError: ROW_RANGE, VOLUME_RANGE, ACKNOWLEDGEMENT or VOLUME_MISMATCH.
        """
        is_near = header.tick <= self.tick + 1 + PIPELINE_DEPTH
        if is_near and session.expects(header):
            session.check_header(header)
            self.accounts.check_totals(header)
            session.add_header(header)

    def _checked_rows(self, session: MachineSession) -> tuple[Rows, Rows]:
        """Return the SWEEP and the DEPOSIT_REQUEST rows of a complete tick of a machine.

        Raises:
            ExchangeError: ROW_DIGEST or DEPOSIT_VOLUME; see `poll`.
        """
        try:
            sweeps, deposit_requests = session.tick_rows()
            self.accounts.check_deposit_requests(session.machine_id, deposit_requests)
        except ExchangeError:
            session.discard_unprocessed()
            raise
        return sweeps, deposit_requests

    def _complete_tick(self, machine_id: int) -> None:
        """Account the totals and acknowledgement of a machine, and discard its rows."""
        header = self._machines[machine_id].complete_tick()
        self.accounts.update_totals(header)
        if header.verb is Verb.LEAVE:
            self._end_session(machine_id)

    def _end_session(self, machine_id: int) -> None:
        self.accounts.leave(machine_id)
        self._machines.remove(machine_id)
        self._admission.end_session(machine_id)

    def _admit(self, published: int) -> list[MachineSession]:
        """Begin the sessions of waiting machines as of this tick; return them.

        Args:
            published: last conversion row published so far.
        """
        requests, rejections = self._admission.admit(self.accounts, published)
        self._outbox += rejections
        admitted = []
        for header in requests:
            backlog = self.accounts.backlog(header.machine_id)
            session = MachineSession(header.machine_id, header.session_id, backlog, self.tick)
            self._machines.add(session)
            admitted.append(session)
        return admitted

    def _retransmit(self, request: RetransmitRequest, session: MachineSession | None) -> None:
        last_header = self._streams.last_header
        if last_header is None:
            return
        if request.stream is Stream.HEADER:  # its receipts show whether the machine was dropped
            self._outbox += self._streams.retransmit(request)
        elif session is None:
            return
        elif request.stream in (Stream.KEYFRAME, Stream.BACKLOG):
            self._outbox += self._welcome.retransmit(request, session, last_header)
        else:
            self._outbox += self._streams.retransmit(request)

"""The sessions of the machines that take part, by machine id."""

from __future__ import annotations

from collections.abc import Iterator

from msg_bridge.contract.messages import (
    MachineReceipt,
    RetransmitRequest,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.exchange.machine_session import MachineSession
from msg_bridge.exchange.session_key import SessionKey

__all__ = ["JoinedMachines"]


class JoinedMachines:
    """One session of each joined machine, in the ascending order of their ids."""

    def __init__(self) -> None:
        self._sessions: dict[int, MachineSession] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    def __contains__(self, machine_id: int) -> bool:
        return machine_id in self._sessions

    def __getitem__(self, machine_id: int) -> MachineSession:
        return self._sessions[machine_id]

    def __iter__(self) -> Iterator[MachineSession]:
        return iter(self._sessions.values())

    @property
    def ids(self) -> tuple[int, ...]:
        """Machine ids, ascending."""
        return tuple(self._sessions)

    @property
    def complete(self) -> tuple[int, ...]:
        """Ids of the machines whose part of the next tick is complete, ascending."""
        return tuple([n for n, session in self._sessions.items() if session.is_complete()])

    @property
    def late(self) -> tuple[int, ...]:
        """Ids of the machines whose part of the next tick is incomplete, ascending."""
        return tuple([n for n, session in self._sessions.items() if not session.is_complete()])

    @property
    def is_missing_rows(self) -> bool:
        """Whether rows that a received header of a late machine counts have not arrived."""
        return any(self._sessions[n].header is not None for n in self.late)

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept, received ones and backlogs."""
        return sum(session.num_buffered_rows for session in self)

    @property
    def receipts(self) -> tuple[MachineReceipt, ...]:
        """Acknowledgements of the rows received, ordered by machine id."""
        return tuple([session.receipt for session in self])

    @property
    def acknowledged(self) -> list[dict[Stream, RowRange]]:
        """Ranges of the soil's rows that each machine has acknowledged, by stream."""
        return [session.acknowledged for session in self]

    def discard_unprocessed(self) -> None:
        """Discard the rows and headers of all machines that are not processed yet."""
        for session in self:
            session.discard_unprocessed()

    def session(self, machine_id: int, session_id: int) -> MachineSession | None:
        """Return a session; None if the machine takes no part or is in another session."""
        session = self._sessions.get(machine_id)
        return session if session is not None and session.session_id == session_id else None

    def add(self, session: MachineSession) -> None:
        """Add the session of a machine that takes no part so far."""
        sessions = {**self._sessions, session.machine_id: session}
        self._sessions = dict(sorted(sessions.items()))

    def remove(self, machine_id: int) -> None:
        """Remove the session of a machine that takes part."""
        del self._sessions[machine_id]

    def record_published(self, header: SoilHeader) -> None:
        """Record a published header in all sessions."""
        for session in self:
            session.record_published(header)

    def missing(self, run_id: int, next_tick: int) -> list[RetransmitRequest]:
        """Return requests for what late machines have not delivered of the next tick."""
        requests = []
        for machine_id in self.late:
            session = self._sessions[machine_id]
            if session.header is None:
                missing = [(Stream.HEADER, RowRange(min(next_tick, session.last_tick + 1), 1))]
            else:
                missing = session.gaps()
            key = SessionKey(run_id, machine_id, session.session_id)
            requests += [key.request(stream, gap) for stream, gap in missing]
        return requests

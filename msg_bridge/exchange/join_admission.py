"""Admission of machines: join requests wait for the end of the tick and may be rejected.

A request begins a session with an id that its machine has not used before. While the machine takes
part in another session, the request *contends* for it: it has no effect but that the session may be
dropped if it is silent while the request is repeated, and must be repeated after the session has
ended, as a machine node does.
So a node that was restarted joins as soon as its earlier session is found to be silent. A single
request of another publisher neither disturbs a machine that takes part nor takes its place when it
leaves.
"""

from __future__ import annotations

from collections import Counter, deque

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import JoinRejected, MachineHeader, Verb
from msg_bridge.exchange.ledger_accounts import LedgerAccounts

__all__ = ["JoinAdmission"]

_MAX_KEPT_SESSION_IDS = 1000
"""Number of the latest session ids of each machine that cannot be used again."""


class JoinAdmission:
    """Join requests of one run."""

    def __init__(self, run_id: int, allowed: frozenset[int] | None = None) -> None:
        """
        Args:
            run_id: number of the run.
            allowed: ids of the machines that may join; None: any.
        """
        self._run_id = run_id
        self._allowed = allowed
        self._waiting: dict[int, MachineHeader] = {}
        self._contending: Counter[int] = Counter()  # requests by machine id
        self._session_ids: dict[int, deque[int]] = {}  # used ones by machine id
        self._rejections: dict[int, JoinRejected] = {}

    @property
    def waiting(self) -> frozenset[int]:
        """Machines whose request waits for the end of the tick."""
        return frozenset(self._waiting)

    @property
    def requests(self) -> tuple[MachineHeader, ...]:
        """The requests that wait for the end of the tick, ascending by machine id."""
        return tuple(header for _, header in sorted(self._waiting.items()))

    @property
    def rejoining(self) -> frozenset[int]:
        """Waiting machines that request to rejoin with their soil."""
        return frozenset(n for n, each in self._waiting.items() if each.verb is Verb.REJOIN)

    @property
    def contending_requests(self) -> dict[int, int]:
        """Number of requests to join as a machine during its present session, by machine id."""
        return dict(self._contending)

    def add(self, header: MachineHeader, *, is_joined: bool) -> JoinRejected | None:
        """Add a request of a machine that is not joined in this session.

        Args:
            header: the request.
            is_joined: whether the machine takes part in another session.

        Returns:
            The rejection of a request that was rejected, of a session that is over, or of a machine
            that is not allowed; None if the request waits, or contends, now.
        """
        machine_id, session_id = header.machine_id, header.session_id
        if self._allowed is not None and machine_id not in self._allowed:
            return self._rejection(
                header,
                f"machine {machine_id} is not among the expected machines"
                f" ({', '.join(map(str, sorted(self._allowed))) or 'none'}); add it to"
                " expected_machines of the soil, or set admit_other_machines",
            )
        used = self._session_ids.setdefault(machine_id, deque(maxlen=_MAX_KEPT_SESSION_IDS))
        if session_id not in used:
            if is_joined:
                self._contending[machine_id] += 1
            else:
                used.append(session_id)
                self._waiting[machine_id] = header
            return None
        rejection = self._rejections.get(machine_id)
        if rejection is not None and rejection.session_id == session_id:
            return rejection
        if machine_id in self._waiting and self._waiting[machine_id].session_id == session_id:
            return None
        return self._rejection(
            header,
            f"session {session_id} of machine {machine_id} is over; join in a session with another"
            " id",
        )

    def end_session(self, machine_id: int) -> None:
        """End the contention for a machine: the next request waits for the end of the tick."""
        self._contending.pop(machine_id, None)

    def admit(
        self, accounts: LedgerAccounts, published: int
    ) -> tuple[list[MachineHeader], list[JoinRejected]]:
        """Decide all waiting requests at the end of a tick.

        Args:
            accounts: opened for each admitted machine.
            published: last conversion row published so far.

        Returns:
            (requests of the admitted machines, rejections), each ordered by machine id.
        """
        admitted: list[MachineHeader] = []
        rejected: list[JoinRejected] = []
        if not self._waiting:  # as in most ticks
            return admitted, rejected
        for header in self.requests:
            try:
                if header.verb is Verb.REJOIN:
                    accounts.rejoin(header, published)
                else:
                    accounts.join(header.machine_id, published)
            except ExchangeError as error:
                rejection = self._rejection(header, error.coded_message)
                self._rejections[header.machine_id] = rejection
                rejected.append(rejection)
                continue
            self._rejections.pop(header.machine_id, None)
            admitted.append(header)
        self._waiting.clear()
        return admitted, rejected

    def _rejection(self, header: MachineHeader, reason: str) -> JoinRejected:
        return JoinRejected(self._run_id, header.machine_id, header.session_id, reason)

"""Admission of machines: join requests wait for the end of the tick and may be rejected."""

from __future__ import annotations

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import JoinRejected, MachineHeader, Verb
from msg_bridge.exchange.ledger_accounts import LedgerAccounts

__all__ = ["JoinAdmission"]


class JoinAdmission:
    """Join requests of one run."""

    def __init__(self, run_id: int) -> None:
        self._run_id = run_id
        self._waiting: dict[int, MachineHeader] = {}
        self._latest_session_ids: dict[int, int] = {}
        self._rejections: dict[int, JoinRejected] = {}

    @property
    def waiting(self) -> frozenset[int]:
        """Machines whose request waits for the end of the tick."""
        return frozenset(self._waiting)

    def is_new_session(self, header: MachineHeader) -> bool:
        """Return whether a request begins a session later than all before."""
        return header.session_id > self._latest_session_ids.get(header.machine_id, 0)

    def add(self, header: MachineHeader) -> JoinRejected | None:
        """Add a request of a machine that is not joined in this session.

        Returns:
            The rejection of a request that was rejected, or of a session that is over; None if the
            request waits now.
        """
        machine_id, session_id = header.machine_id, header.session_id
        latest = self._latest_session_ids.get(machine_id, 0)
        if session_id > latest:
            self._waiting[machine_id] = header
            self._latest_session_ids[machine_id] = session_id
            return None
        rejection = self._rejections.get(machine_id)
        if rejection is not None and rejection.session_id == session_id:
            return rejection
        if session_id == latest and machine_id in self._waiting:
            return None
        reason = f"machine {machine_id} has used session {latest} already; join with a larger one"
        return JoinRejected(self._run_id, machine_id, session_id, reason)

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
        admitted, rejected = [], []
        for machine_id, header in sorted(self._waiting.items()):
            try:
                if header.verb is Verb.REJOIN:
                    accounts.rejoin(header, published)
                else:
                    accounts.join(machine_id, published)
            except ExchangeError as error:
                reason = str(error)
                rejection = JoinRejected(self._run_id, machine_id, header.session_id, reason)
                self._rejections[machine_id] = rejection
                rejected.append(rejection)
                continue
            self._rejections.pop(machine_id, None)
            admitted.append(header)
        self._waiting.clear()
        return admitted, rejected

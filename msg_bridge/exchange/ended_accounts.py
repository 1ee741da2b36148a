"""The ended accounts of one machine id: a machine may rejoin with their soil, or it is released."""

from __future__ import annotations

from typing import NamedTuple

from msg_bridge.contract.messages import MachineHeader
from msg_bridge.exchange.machine_account import MachineAccount

__all__ = ["MAX_REJOINABLE_ACCOUNTS", "EndedAccounts", "MergedAccount"]

MAX_REJOINABLE_ACCOUNTS = 16
"""Number of the last ended accounts of a machine id that a machine can rejoin with."""


class MergedAccount(NamedTuple):
    """An account that was added to another one, and is discarded.

    Attributes:
        number: number of the account.
        target: number of the account that has its soil now.
    """

    number: int
    target: int


class EndedAccounts:
    """The last ended accounts of a machine id, and one account with the soil of all older ones.

    Memory is bounded over any number of joins: older accounts can only be released, for which their
    sum is sufficient. An ended account does not change, so its volume is computed once.

    Attributes:
        volume: soil of all of them, once the rows not acknowledged are applied [mm^3].
    """

    def __init__(self) -> None:
        self.volume = 0
        self._accounts: list[MachineAccount] = []  # the oldest first
        self._older: dict[int, int] = {}  # volume by number of the account, at most one

    @property
    def is_empty(self) -> bool:
        """Whether there is none."""
        return not self._accounts and not self._older

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the accounts."""
        return (*self._older, *(account.number for account in self._accounts))

    def add(self, account: MachineAccount) -> MergedAccount | None:
        """Add an account that has ended; return the one that was merged with older ones."""
        self._accounts.append(account)
        self.volume += account.volume
        if len(self._accounts) <= MAX_REJOINABLE_ACCOUNTS:
            return None
        oldest = self._accounts.pop(0)
        volume = oldest.volume
        if not volume:
            return None
        target = next(iter(self._older), oldest.number)
        self._older[target] = self._older.get(target, 0) + volume
        return MergedAccount(oldest.number, target) if target != oldest.number else None

    def take_matching(self, header: MachineHeader) -> MachineAccount | None:
        """Remove and return the last account that a request to rejoin matches; None without one."""
        for account in reversed(self._accounts):
            if account.matches(header):
                self._accounts.remove(account)
                self.volume -= account.volume
                return account
        return None

    def release(self) -> dict[int, int]:
        """Discard all accounts; return the volume by number of the account [mm^3]."""
        volumes = self._older | {account.number: account.volume for account in self._accounts}
        self.volume = 0
        self._accounts, self._older = [], {}
        return volumes

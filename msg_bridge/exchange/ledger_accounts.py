"""The accounts of soil that is not terrain [mm^3 bank].

Every account is counted independently: in flight from the conversion rows, pending and particles as
each machine reports them, absent from the last report of a machine that left, outside from the
OUTSIDE rows. None is computed by subtraction, so that soil lost anywhere shows as an imbalance.

A machine has one account from a JOIN on, over all its rejoins. A further JOIN of the same machine
id opens another one, without soil, and ends the account before, whose soil is absent. It may come
from another process, so an ended account is kept until its soil is released: the machine that holds
the soil can still rejoin with it. Of each machine id that is possible with the last
`MAX_REJOINABLE_ACCOUNTS` ended accounts; older ones are merged into one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, RowRange
from msg_bridge.contract.rows import (
    ENDED_SESSION,
    ConversionKind,
    Rows,
    has_kind,
    machine_ids_in,
    rows_of_machine,
)
from msg_bridge.exchange.ended_accounts import EndedAccounts, MergedAccount
from msg_bridge.exchange.machine_account import MachineAccount, signed_volume

__all__ = ["LedgerAccounts"]


class LedgerAccounts:
    """Accounts of all machines, and the soil outside of the map.

    Attributes:
        merged: accounts that were merged at the end of the last tick.
    """

    def __init__(self) -> None:
        self._machines: dict[int, MachineAccount] = {}  # by machine id
        self._ended: dict[int, EndedAccounts] = {}  # by machine id, none empty
        self.merged: list[MergedAccount] = []
        # By machine id, the smallest `applied` of the accounts that were empty when they ended, and
        # discarded.
        self._applied_of_discarded: dict[int, int] = {}
        self._num_opened = 0
        # Volume released and not deposited yet, by the machine id of the rows that deposit it.
        self._released: dict[int, int] = {}
        self._outside = 0
        self._start: int | None = None
        # The results of the properties of the same names, until they change.
        self._joined_accounts: dict[int, int] | None = None
        self._account_numbers: frozenset[int] | None = None

    @property
    def last_row_acknowledged_by_all(self) -> int:
        """Last conversion row that no joined machine needs; 2**63 - 1 if no machine is joined."""
        rows = [a.last_row_not_needed for a in self._machines.values() if a.is_joined]
        return min(rows, default=2**63 - 1)

    def in_flight(self, machine_id: int) -> int:
        """Return the signed volume of the rows that a machine has not acknowledged [mm^3]."""
        return self._machines[machine_id].in_flight

    def backlog(self, machine_id: int) -> Rows:
        """Return the CONVERSION rows that a machine has not acknowledged, in order."""
        return self._machines[machine_id].backlog

    @property
    def absent(self) -> tuple[int, ...]:
        """Ids of the machines that take no part and have left soil behind, ascending."""
        return tuple(
            n
            for n, a in sorted(self._machines.items())
            if not a.is_joined and a.volume + self._ended_volume(n)
        )

    @property
    def joined_accounts(self) -> dict[int, int]:
        """Number of the account of each machine that takes part, by machine id."""
        if self._joined_accounts is None:
            joined = {n: a.number for n, a in self._machines.items() if a.is_joined}
            self._joined_accounts = joined
        return self._joined_accounts

    @property
    def account_numbers(self) -> frozenset[int]:
        """Numbers of all accounts: of each machine that has joined, and the ended ones."""
        if self._account_numbers is None:
            numbers = frozenset([account.number for account in self._machines.values()])
            ended = [ended.numbers for ended in self._ended.values()]
            self._account_numbers = numbers.union(*ended)
        return self._account_numbers

    @property
    def machines_with_ended_accounts(self) -> tuple[int, ...]:
        """Ids of the machines that have ended accounts, ascending."""
        return tuple(sorted(self._ended))

    @property
    def ended_volumes(self) -> dict[int, int]:
        """Soil in the ended accounts of joined machines [mm^3], none of it 0, by machine id."""
        return {
            n: self._ended_volume(n)
            for n, a in sorted(self._machines.items())
            if a.is_joined and self._ended_volume(n) > 0
        }

    def check(self, conversions: Rows) -> None:
        """Check that each row has a joined machine to acknowledge it.

        Released soil needs no acknowledgement, but must be deposited in full.

        Raises:
            ExchangeError: NOT_JOINED or RELEASE.
        """
        for machine_id, released in self._released.items():
            deposited = -signed_volume(rows_of_machine(conversions, machine_id))
            if deposited != released:
                raise ExchangeError(
                    f"{released} mm^3 were released, but conversion rows with machine id"
                    f" {machine_id} deposit {deposited} mm^3; deposit all of it",
                    ErrorCode.RELEASE,
                )
        for machine_id in machine_ids_in(conversions):
            account = self._machines.get(machine_id)
            if machine_id not in self._released and (account is None or not account.is_joined):
                raise ExchangeError(
                    f"there are conversion rows of machine {machine_id}, which has not joined",
                    ErrorCode.NOT_JOINED,
                )

    def add_in_flight(self, span: RowRange, conversions: Rows) -> None:
        """Add published rows to the rows in flight, and count the soil that left the map."""
        if conversions.size:
            self._outside += _outside_volume(conversions)
            numbers = np.arange(span.first, span.first + span.count, dtype=np.int64)
            machine_ids = machine_ids_in(conversions)
            for machine_id in machine_ids:
                if machine_id not in self._released:
                    own = (
                        conversions["machine_id"] == machine_id
                        if len(machine_ids) > 1
                        else slice(None)
                    )
                    self._machines[machine_id].add_in_flight(numbers[own], conversions[own])
        self._released.clear()
        self.merged.clear()

    def check_totals(self, header: MachineHeader) -> None:
        """Check that the soil a machine reports is what it was credited with.

        Args:
            header: a tick of a joined machine that was not processed before.

        Raises:
            ExchangeError: VOLUME_MISMATCH.
        """
        account = self._machines[header.machine_id]
        expected = account.expected(header.conversions_received)
        if header.soil_mm3 != expected:
            raise ExchangeError(
                f"machine {header.machine_id} reports {header.soil_mm3} mm^3 of soil at tick"
                f" {header.tick}; the conversion rows that it acknowledges give {expected} mm^3",
                ErrorCode.VOLUME_MISMATCH,
            )

    def check_deposit_requests(self, machine_id: int, deposit_requests: Rows) -> None:
        """Check that a machine holds the soil that it requests to deposit, and requests it once.

        Args:
            machine_id: a joined machine.
            deposit_requests: its DEPOSIT_REQUEST rows of a tick.

        Raises:
            ExchangeError: DEPOSIT_VOLUME.
        """
        if deposit_requests.size == 0:
            return
        account = self._machines[machine_id]
        requested = int(deposit_requests["volume_mm3"].sum(dtype=np.int64))
        if requested > account.volume:
            raise ExchangeError(
                f"machine {machine_id} requests to deposit {requested} mm^3 of soil, and holds"
                f" {account.volume} mm^3",
                ErrorCode.DEPOSIT_VOLUME,
            )
        ids = set(deposit_requests["particle_id"].tolist())
        if len(ids) < deposit_requests.size or ids & account.deposited_particles:
            raise ExchangeError(
                f"machine {machine_id} requests to deposit a particle twice",
                ErrorCode.DEPOSIT_VOLUME,
            )

    def update_totals(self, header: MachineHeader) -> None:
        """Set a machine's totals as of the conversion row that a processed tick acknowledges."""
        account = self._machines[header.machine_id]
        account.update_totals(header.pending_mm3, header.particles_mm3, header.conversions_received)
        account.confirm_rejoin()

    def join(self, machine_id: int, published: int) -> None:
        """Open an account without soil for a machine; the one before has ended.

        Args:
            machine_id: its number.
            published: last conversion row published so far; it needs none of those.
        """
        self._accounts_changed()
        self._end_account(machine_id)
        self._num_opened += 1
        self._machines[machine_id] = MachineAccount(self._num_opened, published)

    def rejoin(self, header: MachineHeader, published: int) -> None:
        """Continue the account of a machine that holds the soil it left with.

        That is the last account of its machine id whose soil it is, also if another one was opened
        since then. A machine whose account was empty when it ended gets a new one.

        Args:
            header: its request.
            published: last conversion row published so far; of those it receives its backlog.

        Raises:
            ExchangeError: REJOIN_VOLUME: it never took part, or reports another volume.
        """
        self._accounts_changed()
        machine_id = header.machine_id
        last = self._machines.get(machine_id)
        if last is None:
            raise ExchangeError(
                f"machine {machine_id} requests to rejoin but has never taken part; join",
                ErrorCode.REJOIN_VOLUME,
            )
        account = last if last.matches(header) else self._take_ended(header)
        if account is None:
            if self._left_empty(header, published):
                self.join(machine_id, published)
                return
            raise ExchangeError(
                f"machine {machine_id} requests to rejoin with {header.soil_mm3} mm^3 of soil; no"
                f" session of machine {machine_id} left with that soil; join without soil, or"
                " restore its state",
                ErrorCode.REJOIN_VOLUME,
            )
        if account is not last:
            self._end_account(machine_id)
            self._machines[machine_id] = account
        account.rejoin(header, published)

    def release(self, machine_id: int) -> dict[int, int]:
        """Take over the soil of an absent machine; the next rows must deposit it.

        Returns:
            Volume by number of the account that held it [mm^3], none of them 0.
        """
        self._accounts_changed()
        account = self._machines.get(machine_id)
        if account is None or account.is_joined:
            return {}
        ended = self._ended.pop(machine_id, EndedAccounts())
        return self._release(ended.release() | {account.number: account.release()}, machine_id)

    def release_ended(self, machine_id: int) -> dict[int, int]:
        """Take over the soil of the ended accounts of a machine, and discard them.

        The next rows must deposit it with the machine id `ENDED_SESSION`.

        Returns:
            As `release`.
        """
        self._accounts_changed()
        ended = self._ended.pop(machine_id, EndedAccounts())
        return self._release(ended.release(), ENDED_SESSION)

    def leave(self, machine_id: int) -> None:
        """End the session of a machine: its soil is absent, its unacknowledged rows are kept."""
        self._accounts_changed()
        self._machines[machine_id].leave()

    def ledger(self, run_id: int, tick: int, terrain: int) -> Ledger:
        """Return the ledger of a tick; the sum of the first one is the start.

        Args:
            run_id: number of the run.
            tick: the tick that ended.
            terrain: volume of the terrain [mm^3].
        """
        in_flight = pending = particles = absent = 0
        for machine_id, account in self._machines.items():
            in_flight += account.in_flight
            absent += self._ended_volume(machine_id)
            if account.is_joined:
                pending += account.pending
                particles += account.particles
            else:
                absent += account.total
        accounts = (terrain, in_flight, pending, particles, absent, self._outside)
        if self._start is None:
            self._start = sum(accounts)
        return Ledger(run_id, tick, *accounts, self._start)

    def _accounts_changed(self) -> None:
        """Compute again, when it is needed, which accounts there are and which are joined."""
        self._joined_accounts = self._account_numbers = None

    def _end_account(self, machine_id: int) -> None:
        """Keep the account of a machine among the ended ones, unless it is empty."""
        account = self._machines.get(machine_id)
        if account is None:
            return
        if account.is_empty:
            applied = self._applied_of_discarded.get(machine_id, account.applied)
            self._applied_of_discarded[machine_id] = min(applied, account.applied)
        else:
            merged = self._ended.setdefault(machine_id, EndedAccounts()).add(account)
            if merged is not None:
                self.merged.append(merged)

    def _take_ended(self, header: MachineHeader) -> MachineAccount | None:
        """Remove and return the ended account that a request to rejoin matches, if any."""
        ended = self._ended.get(header.machine_id)
        if ended is None:
            return None
        account = ended.take_matching(header)
        if ended.is_empty:
            del self._ended[header.machine_id]
        return account

    def _left_empty(self, header: MachineHeader, published: int) -> bool:
        """Return whether a request to rejoin can be that of a machine with a discarded account."""
        applied = self._applied_of_discarded.get(header.machine_id)
        if applied is None or header.soil_mm3 != 0:
            return False
        return applied <= header.conversions_received <= published

    def _ended_volume(self, machine_id: int) -> int:
        """Return the soil of the ended accounts of a machine [mm^3]."""
        ended = self._ended.get(machine_id)
        return 0 if ended is None else ended.volume

    def _release(self, volumes: Mapping[int, int], machine_id: int) -> dict[int, int]:
        """Record volumes by account that the next rows deposit with a machine id [mm^3].

        Returns:
            Those that are not 0.
        """
        released = {number: volume for number, volume in volumes.items() if volume}
        if released:
            total = self._released.get(machine_id, 0) + sum(released.values())
            self._released[machine_id] = total
        return released


def _outside_volume(conversions: Rows) -> int:
    """Return the volume of the OUTSIDE rows [mm^3]."""
    if not has_kind(conversions, ConversionKind.OUTSIDE):  # as in most ticks
        return 0
    is_outside = conversions["kind"] == ConversionKind.OUTSIDE
    return int(conversions["volume_mm3"][is_outside].sum(dtype=np.int64))

"""The accounts of one machine id, by its headers and its conversion rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.contract.messages import MachineHeader
from msg_bridge.contract.rows import ConversionKind

__all__ = ["MachineAccountReplay"]


@dataclass(frozen=True)
class _Account:
    """Account of a machine from a JOIN on.

    Attributes:
        pending, particles: soil in its last header [mm^3].
        received: number of the last conversion row included in that soil.
        excluded: ranges (after, through) of conversion rows with the machine id that are not in
            flight to this machine: those published while another process took part with the machine
            id, and those whose soil was released. The rows of a range are after + 1 to through.
    """

    pending: int = 0
    particles: int = 0
    received: int = 0
    excluded: tuple[tuple[int, int], ...] = ()

    @property
    def total(self) -> int:
        """All soil in the last header [mm^3]."""
        return self.pending + self.particles


@dataclass(frozen=True)
class _EndedAccount:
    """Account that ended with another JOIN of the machine id, after conversion row `published`."""

    account: _Account
    published: int


class MachineAccountReplay:
    """The last account of a machine id, and its ended accounts.

    Attributes:
        present: whether the machine takes part.
    """

    def __init__(
        self, machine_id: int, conversions: NumberedRows, released: NDArray[np.bool_]
    ) -> None:
        """Begin with an empty machine.

        Args:
            machine_id: the machine.
            conversions: the conversion rows of the run.
            released: whether each of them released soil of an absent machine, shape (rows,).
        """
        own = (conversions.rows["machine_id"] == machine_id) & ~released
        rows = conversions.rows[own]
        volume = rows["volume_mm3"].astype(np.int64)
        returned = np.isin(rows["kind"], (ConversionKind.DEPOSIT, ConversionKind.OUTSIDE))
        is_excavation = rows["kind"] == ConversionKind.EXCAVATE
        signed = np.where(is_excavation, volume, np.where(returned, -volume, 0))
        self._numbers = conversions.numbers[own]
        self._cumulative_net_volume = np.concatenate([[0], np.cumsum(signed)])
        self.present = False
        self._account = _Account()
        self._before_rejoin: _Account | None = None  # until a tick of the session is accepted
        self._ended: list[_EndedAccount] = []  # the oldest first

    @property
    def received(self) -> int:
        """Number of the last conversion row included in the soil of the last header."""
        return self._account.received

    @property
    def ended_volume(self) -> int:
        """Soil of the ended accounts [mm^3]."""
        return sum(self._expected(each.account, each.published) for each in self._ended)

    def expected(self, received: int) -> int:
        """Return the soil that the machine must have after rows up to `received` [mm^3]."""
        return self._expected(self._account, received)

    def update(self, header: MachineHeader) -> None:
        """Replace the soil by that of the header of an accepted tick."""
        self._before_rejoin = None
        self._set(header)

    def drop(self) -> None:
        """End the session; one without an accepted tick does not change the account."""
        self.present = False
        if self._before_rejoin is not None:
            self._account, self._before_rejoin = self._before_rejoin, None

    def join(self, published: int) -> None:
        """Open an account without soil; the one before has ended.

        Args:
            published: last conversion row published.
        """
        self._ended.append(_EndedAccount(self._account, published))
        self._account = _Account(received=published)
        self._before_rejoin = None

    def select_account(self, header: MachineHeader, published: int) -> bool:
        """Before a rejoin, return to the last account that a request to rejoin matches.

        Args:
            header: the request.
            published: last conversion row published.

        Returns:
            Whether there is one.
        """
        if self._matches(self._account, header, published):
            return True
        matching = (
            e for e in reversed(self._ended) if self._matches(e.account, header, e.published)
        )
        ended = next(matching, None)
        if ended is None:
            return False
        self._ended.remove(ended)
        self._ended.append(_EndedAccount(self._account, published))
        account = ended.account
        other_session = (ended.published, published)
        self._account = replace(account, excluded=(*account.excluded, other_session))
        return True

    def rejoin(self, header: MachineHeader) -> None:
        """Continue the account with a request to rejoin."""
        before = self._account
        self._set(header)
        self._before_rejoin = before

    def release(self, published: int) -> int:
        """Remove all soil of an absent machine; return the volume [mm^3].

        Args:
            published: last conversion row published.
        """
        account = self._account
        volume = self._expected(account, published) + self.release_ended()
        in_flight = (account.received, published)
        self._account = replace(account, pending=0, particles=0, excluded=(in_flight,))
        return volume

    def release_ended(self) -> int:
        """Remove all soil of the ended accounts; return the volume [mm^3]."""
        volume = self.ended_volume
        self._ended.clear()
        return volume

    def balances(self, published: int) -> tuple[int, int, int, int]:
        """Return (in flight, pending, particles, absent) after row `published` [mm^3]."""
        account, absent = self._account, self.ended_volume
        in_flight = self._in_flight(account, published)
        if self.present:
            return in_flight, account.pending, account.particles, absent
        return in_flight, 0, 0, absent + account.total

    def _set(self, header: MachineHeader) -> None:
        self._account = replace(
            self._account,
            pending=header.pending_mm3,
            particles=header.particles_mm3,
            received=header.conversions_received,
        )

    def _matches(self, account: _Account, header: MachineHeader, published: int) -> bool:
        """Return whether a header reports an account whose rows end with `published`."""
        received = header.conversions_received
        expected = self._expected(account, min(received, published))
        return received >= account.received and header.soil_mm3 == expected

    def _expected(self, account: _Account, received: int) -> int:
        """Return the soil of an account after rows up to `received` [mm^3]."""
        return account.total + self._in_flight(account, received)

    def _in_flight(self, account: _Account, through: int) -> int:
        """Return the signed volume of the rows of an account after its last header [mm^3]."""
        volume = self._net_volume(account.received, through)
        for begin, end in account.excluded:
            volume -= self._net_volume(max(account.received, begin), min(through, end))
        return volume

    def _net_volume(self, after: int, through: int) -> int:
        """Return the volume of rows after + 1 to through [mm^3]: excavated +, deposited -."""
        low, high = np.searchsorted(self._numbers, (after, through), side="right")
        return int(self._cumulative_net_volume[max(high, low)] - self._cumulative_net_volume[low])

"""The accounts of every tick, recomputed from rows and headers alone.

Written from the protocol and apart from the exchange's own accounts, so that an error in those
shows as a difference between the ledger published and the one recomputed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.differences import difference_finding
from msg_bridge.audit.membership import (
    MembershipChange,
    MembershipEvent,
    MembershipTimeline,
    SoilTicks,
)
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers, contiguous_ranges
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, Stream, Verb
from msg_bridge.contract.rows import ConversionKind

__all__ = ["ACCOUNTS", "AccountsAudit", "audit_accounts"]

ACCOUNTS = ("terrain", "in_flight", "pending", "particles", "absent", "outside")

_MAX_FINDINGS = 10  # machines' headers that do not add up, told one by one


@dataclass
class AccountsAudit:
    """What became of the soil that is not terrain.

    Attributes:
        imbalance: of each tick audited [mm^3]; None if it cannot be computed.
        start: sum of all accounts at the first tick audited.
        checks, findings, notes: how far it went, what is wrong, what else to know.
    """

    imbalance: Numbers | None = None
    start: int | None = None
    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


class _MachineAccount:
    """One source: what it last said it holds, and the volumes moved for it.

    Attributes:
        present: whether it takes part.
        pending, particles: as it last said.
        received: last conversion row in those figures.
        abandoned: what its former lives held and can no longer come back.
    """

    def __init__(
        self, machine_id: int, conversions: NumberedRows, released: NDArray[np.bool_]
    ) -> None:
        own = conversions.rows["machine_id"] == machine_id
        rows = conversions.rows[own]
        volume = rows["volume_mm3"].astype(np.int64)
        released = released[own]
        back = np.isin(rows["kind"], (ConversionKind.DEPOSIT, ConversionKind.OUTSIDE)) & ~released
        signed = np.where(
            rows["kind"] == ConversionKind.EXCAVATE, volume, np.where(back, -volume, 0)
        )
        self._numbers = conversions.numbers[own]
        self._cumulative_net_volume = np.concatenate([[0], np.cumsum(signed)])
        self._cumulative_released = np.concatenate([[0], np.cumsum(np.where(released, volume, 0))])
        self.present = False
        self.pending = self.particles = self.lost_with_session = 0
        self.received = 0

    @property
    def reported_total(self) -> int:
        return self.pending + self.particles

    def net_volume(self, first: int, last: int) -> int:
        """Signed volume of rows `first` + 1 to `last`: excavated +, given back -."""
        low, high = np.searchsorted(self._numbers, (first, last), side="right")
        return int(self._cumulative_net_volume[max(high, low)] - self._cumulative_net_volume[low])

    def released(self, last: int) -> int:
        """What was put down for it up to row `last`."""
        return int(self._cumulative_released[np.searchsorted(self._numbers, last, side="right")])

    def expected(self, received: int) -> int:
        """What it should hold once it has rows up to `received`."""
        return self.reported_total + self.net_volume(self.received, received)

    def update(self, header: MachineHeader) -> None:
        """Take its figures."""
        self.pending, self.particles = header.pending_mm3, header.particles_mm3
        self.received = header.conversions_received

    def start_empty_session(self, published: int) -> None:
        """Begin a life that holds nothing; what the former one held is left where it was lost."""
        self.lost_with_session += self.expected(published)
        self.pending = self.particles = 0
        self.received = published

    def balances(self, last: int) -> tuple[int, int, int, int]:
        """(in flight, pending, particles, absent) after conversion row `last`."""
        flight = self.net_volume(self.received, last)
        absent = self.lost_with_session - self.released(last)
        if self.present:
            return flight, self.pending, self.particles, absent
        absent += self.reported_total
        if absent + flight == 0:  # released: what was on its way to it went with the rest
            return 0, 0, 0, 0
        return flight, 0, 0, absent


def audit_accounts(
    soil: SoilTicks,
    window: Window,
    timeline: MembershipTimeline,
    conversions: NumberedRows,
    released: NDArray[np.bool_],
    terrain: Numbers | None,
    ledgers: Mapping[int, Ledger],
) -> AccountsAudit:
    """Recompute the accounts of every tick in the window and compare with the ledgers.

    Args:
        released: which conversion rows put down what an absent machine left.
        terrain: of each soil tick; None if it is not known.
    """
    result = AccountsAudit()
    books = _AccountReplay(soil, window, timeline, conversions, released, result)
    computed, known = books.run()
    if terrain is None:
        why = "the terrain is not known at any tick"
        result.checks += [CheckResult(c, False, why) for c in (Check.ACCOUNTS, Check.LEDGER)]
        return result
    computed[:, 0] = terrain[window.indices]
    ticks = soil.ticks[window.indices]
    low, high = int(ticks[0]), int(ticks[-1])
    base = ledgers.get(low)
    start = int(computed[0].sum())
    detail = f"ticks {low}..{high}, {books.num_headers} machine headers"
    from_start = soil.from_start and window.first == 0
    if not from_start:
        # What left, or went, before the bag begins is in no row of it.
        if base is not None:
            before = np.array([getattr(base, name) for name in ACCOUNTS]) - computed[0]
            keep = [ACCOUNTS.index(name) for name in ("in_flight", "absent", "outside")]
            computed[:, keep] += before[keep]
            start = base.start
        detail += f"; from tick {low} on only, what was before is taken from its ledger"
    result.start = start
    result.imbalance = computed.sum(axis=1) - start
    what = "the sum of all accounts is off"
    finding = difference_finding(Check.ACCOUNTS, what, ticks, result.imbalance)
    result.findings += [finding] if finding else []
    done = from_start and not books.unknown
    detail += "".join(f"; {each}" for each in books.unknown)
    result.checks.append(CheckResult(Check.ACCOUNTS, done, detail))
    _compare(result, ticks, computed, known, start, ledgers)
    return result


class _AccountReplay:
    """Walks through the ticks."""

    def __init__(
        self,
        soil: SoilTicks,
        window: Window,
        timeline: MembershipTimeline,
        conversions: NumberedRows,
        released: NDArray[np.bool_],
        result: AccountsAudit,
    ) -> None:
        self._soil, self._window, self._story, self._result = soil, window, timeline, result
        self._conversions, self._cumulative_released = conversions, released
        self._accounts: dict[int, _MachineAccount] = {}
        self._num_wrong_headers = 0
        self.num_headers = 0
        self.unknown: list[str] = []

    def run(self) -> tuple[Numbers, np.ndarray]:
        """(accounts of each tick, shape (ticks, 6), terrain 0; whether each tick is known)."""
        last_rows = self._soil.spans[Stream.CONVERSION].last
        left = self._conversions.rows["kind"] == ConversionKind.OUTSIDE
        volume = self._conversions.rows["volume_mm3"].astype(np.int64)
        outside = np.concatenate([[0], np.cumsum(np.where(left, volume, 0))])
        outside = outside[self._conversions.count_through(last_rows)]
        computed, known = [], []
        for index in range(self._window.last + 1):
            last = int(last_rows[index])
            for event in self._story.events[index]:
                self._apply_event(event, index, last)
            if index < self._window.first:
                continue
            balances = np.array([a.balances(last) for a in self._accounts.values()], dtype=np.int64)
            computed.append([0, *balances.reshape(-1, 4).sum(axis=0).tolist(), int(outside[index])])
            known.append(not any(event.is_header_missing for event in self._story.events[index]))
        return np.array(computed, dtype=np.int64), np.array(known, dtype=np.bool_)

    def _apply_event(self, event: MembershipEvent, index: int, last: int) -> None:
        machine_id = event.session_id[0]
        new = machine_id not in self._accounts
        if new:
            self._accounts[machine_id] = _MachineAccount(
                machine_id, self._conversions, self._cumulative_released
            )
        account, header = self._accounts[machine_id], event.header
        if event.change is MembershipChange.DROPPED:
            account.present = False
            return
        account.present = event.change is not MembershipChange.LEFT
        if event.change is MembershipChange.JOINED:
            returns = event.backlog > 0 if header is None else header.verb is Verb.REJOIN
            if not returns:
                account.start_empty_session(last)
                return
            if new and not self._soil.from_start:
                tick = int(self._soil.ticks[index])
                self.unknown.append(
                    f"machine {machine_id} comes back in tick {tick} from before the bag begins"
                )
        if header is not None:
            # Where the bag begins, it may lack rows between two of a machine's headers.
            numbers = self._conversions.numbers
            all_here = self._soil.from_start or bool((numbers[:1] <= account.received + 1).all())
            if not new and all_here and index >= self._window.first:
                self._check(account, header, event, int(self._soil.ticks[index]), last)
            account.update(header)
            self.num_headers += 1

    def _check(
        self,
        account: _MachineAccount,
        header: MachineHeader,
        event: MembershipEvent,
        tick: int,
        last: int,
    ) -> None:
        """A machine holds what it held and what it was given since."""
        excess = header.soil_mm3 - account.expected(header.conversions_received)
        backwards = header.conversions_received < account.received
        ahead = header.conversions_received > last
        if not (excess or backwards or ahead):
            return
        self._num_wrong_headers += 1
        if self._num_wrong_headers > _MAX_FINDINGS:
            return
        which = "on its return before" if event.change is MembershipChange.JOINED else "in"
        text = f"machine {header.machine_id} {which} tick {tick} "
        if backwards or ahead:
            text += f"has conversions up to {header.conversions_received}, which cannot be"
        else:
            text += (
                f"holds {abs(excess)} mm3 too {'much' if excess > 0 else 'little'}:"
                f" {header.soil_mm3} mm3, where conversions"
                f" {account.received + 1}..{header.conversions_received} make"
                f" {header.soil_mm3 - excess} mm3"
            )
        self._result.findings.append(Finding(Check.ACCOUNTS, text, tick, tick))


def _compare(
    result: AccountsAudit,
    ticks: Numbers,
    computed: Numbers,
    known: np.ndarray,
    start: int,
    ledgers: Mapping[int, Ledger],
) -> None:
    """Compare with what was published."""
    if not ledgers:
        result.checks.append(CheckResult(Check.LEDGER, False, "the bag has no ledger"))
        return
    there = np.array([int(tick) in ledgers for tick in ticks])
    for first, last in contiguous_ranges(ticks[~there].tolist()):
        which = f"ledger of tick {first} is" if first == last else f"ledgers of {first}..{last} are"
        text = f"the {which} missing"
        result.findings.append(Finding(Check.COMPLETENESS, text, first, last))
    both = there & known
    published = [ledgers[int(tick)] for tick in ticks[both]]
    for column, name in enumerate(ACCOUNTS):
        told = np.array([getattr(ledger, name) for ledger in published], dtype=np.int64)
        what = f"the ledger's {name} differs"
        finding = difference_finding(Check.LEDGER, what, ticks[both], told - computed[both, column])
        result.findings += [finding] if finding else []
    told = np.array([ledger.start for ledger in published], dtype=np.int64)
    finding = difference_finding(
        Check.LEDGER, "the ledger's start differs", ticks[both], told - start
    )
    result.findings += [finding] if finding else []
    detail = f"{len(published)} ledgers, every account"
    result.checks.append(CheckResult(Check.LEDGER, bool(published), detail))

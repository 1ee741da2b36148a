"""Recompute the accounts of every tick from rows and headers alone.

This follows the protocol and shares no code with the accounts of the exchange, so that an error in
those shows as a difference between the published ledger and the recomputed one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.differences import difference_finding
from msg_bridge.audit.machine_account_replay import MachineAccountReplay
from msg_bridge.audit.membership import MembershipChange, MembershipEvent, MembershipTimeline
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers, contiguous_ranges
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, Stream, Verb
from msg_bridge.contract.rows import ENDED_SESSION, ConversionKind

__all__ = ["ACCOUNTS", "AccountsAudit", "audit_accounts"]

ACCOUNTS = ("terrain", "in_flight", "pending", "particles", "absent", "outside")
"""Names of the accounts in a ledger, in the order of the columns here."""

_MAX_FINDINGS = 10  # wrong machine headers that have a finding of their own


@dataclass
class AccountsAudit:
    """Result of auditing the accounts.

    Attributes:
        imbalance: of each audited tick [mm^3], shape (n,); None if it cannot be computed.
        start: sum of all accounts at the first audited tick [mm^3].
        checks, findings: extent of the checks, and faults.
    """

    imbalance: Numbers | None = None
    start: int | None = None
    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


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
        soil, window, timeline, conversions: the run.
        released: which conversion rows released soil of absent machines, shape (rows,).
        terrain: volume of the terrain after each soil tick [mm^3], shape (ticks,); None if unknown.
        ledgers: the published ledgers by tick.
    """
    result = AccountsAudit()
    replay = _LedgerReplay(soil, window, timeline, conversions, released, result)
    computed, known = replay.run()
    if terrain is None:
        why = "the volume of the terrain is not known at any tick"
        result.checks += [CheckResult(c, False, why) for c in (Check.ACCOUNTS, Check.LEDGER)]
        return result
    computed[:, 0] = terrain[window.indices]
    ticks = soil.ticks[window.indices]
    low, high = int(ticks[0]), int(ticks[-1])
    base = ledgers.get(low)
    start = int(computed[0].sum())
    detail = f"ticks {low}..{high}, {replay.num_headers} machine headers"
    from_start = soil.from_start and window.first == 0
    if not from_start:
        # Soil that left before the bag begins is in no recorded row.
        if base is not None:
            offset = np.array([getattr(base, name) for name in ACCOUNTS]) - computed[0]
            columns = [ACCOUNTS.index(name) for name in ("in_flight", "absent", "outside")]
            computed[:, columns] += offset[columns]
            start = base.start
        detail += f"; from tick {low} on only, earlier movements are taken from its ledger"
    result.start = start
    result.imbalance = computed.sum(axis=1) - start
    subject = "the sum of all accounts is off"
    finding = difference_finding(Check.ACCOUNTS, subject, ticks, result.imbalance)
    result.findings += [finding] if finding else []
    done = from_start and not replay.unknown
    detail += "".join(f"; {each}" for each in replay.unknown)
    result.checks.append(CheckResult(Check.ACCOUNTS, done, detail))
    _compare_ledgers(result, ticks, computed, known, start, ledgers)
    return result


class _LedgerReplay:
    """Replays the events of all ticks.

    Attributes:
        num_headers: number of machine headers applied.
        unknown: reasons why soil that machines held before the bag begins is unknown.
    """

    def __init__(
        self,
        soil: SoilTicks,
        window: Window,
        timeline: MembershipTimeline,
        conversions: NumberedRows,
        released: NDArray[np.bool_],
        result: AccountsAudit,
    ) -> None:
        self._soil, self._window, self._timeline, self._result = soil, window, timeline, result
        self._conversions, self._released = conversions, released
        self._accounts: dict[int, MachineAccountReplay] = {}  # by machine id
        self._released_volumes = _released_volumes(soil, conversions, released)
        # Released volume that was taken from no account here [mm^3]: what machines left behind
        # before the bag begins is unknown.
        self._other_released_volume = 0
        self._num_wrong_headers = 0
        self.num_headers = 0
        self.unknown: list[str] = []

    def run(self) -> tuple[Numbers, NDArray[np.bool_]]:
        """Return the accounts of each audited tick, and whether each tick is known.

        The accounts [mm^3] have shape (ticks, 6), with the terrain left 0.
        """
        last_rows = self._soil.spans[Stream.CONVERSION].last
        is_outside = self._conversions.rows["kind"] == ConversionKind.OUTSIDE
        volume = self._conversions.rows["volume_mm3"].astype(np.int64)
        outside = np.concatenate([[0], np.cumsum(np.where(is_outside, volume, 0))])
        outside = outside[self._conversions.count_through(last_rows)]
        computed, known = [], []
        for index in range(self._window.last + 1):
            last = int(last_rows[index])
            self._apply_tick(index, last)
            if index < self._window.first:
                continue
            balances = np.array([a.balances(last) for a in self._accounts.values()], dtype=np.int64)
            in_machines = balances.reshape(-1, 4).sum(axis=0)
            in_machines[3] -= self._other_released_volume
            computed.append([0, *in_machines.tolist(), int(outside[index])])
            known.append(not any(event.is_header_missing for event in self._timeline.events[index]))
        return np.array(computed, dtype=np.int64), np.array(known, dtype=np.bool_)

    def _apply_tick(self, index: int, last: int) -> None:
        """Apply the events and the releases of a soil tick.

        Args:
            index: index of the soil tick.
            last: its last conversion row.
        """
        # Machines are dropped before the soil is released; they leave and join at the end.
        events = self._timeline.events[index]
        dropped = [event for event in events if event.change is MembershipChange.DROPPED]
        for event in dropped:
            self._apply_event(event, index, last)
        for machine_id, volume in self._released_volumes.get(index, {}).items():
            known = 0
            if machine_id == ENDED_SESSION:
                known = sum(each.release_ended() for each in self._with_ended_volume(volume))
            elif machine_id in self._accounts:
                known = self._accounts[machine_id].release(last)
            self._other_released_volume += volume - known
        for event in events:
            if event not in dropped:
                self._apply_event(event, index, last)

    def _with_ended_volume(self, volume: int) -> list[MachineAccountReplay]:
        """Return the joined machines whose ended accounts have a volume [mm^3]; [] if unknown.

        Rows of ended accounts do not name their machine: they are of all joined ones, or of one.
        """
        joined = [each for each in self._accounts.values() if each.present]
        for machines in (joined, *([each] for each in joined)):
            if sum(each.ended_volume for each in machines) == volume:
                return machines
        return []

    def _apply_event(self, event: MembershipEvent, index: int, last: int) -> None:
        machine_id = event.session.machine_id
        new = machine_id not in self._accounts
        if new:
            self._accounts[machine_id] = MachineAccountReplay(
                machine_id, self._conversions, self._released
            )
        account, header = self._accounts[machine_id], event.header
        if event.change is MembershipChange.DROPPED:
            account.drop()
            return
        account.present = event.change is not MembershipChange.LEFT
        if event.change is MembershipChange.JOINED:
            rejoins = event.backlog > 0 if header is None else header.verb is Verb.REJOIN
            if not rejoins:
                account.join(last)
                return
            is_known = header is None or account.select_account(header, last)
            if header is not None and header.soil_mm3 == 0 and not (is_known or new):
                # Its account was empty when it ended, and was discarded.
                account.join(last)
                return
            if new and not self._soil.from_start:
                tick = int(self._soil.ticks[index])
                self.unknown.append(
                    f"machine {machine_id} rejoins in tick {tick} and left before the bag begins"
                )
        if header is not None:
            # At the start of a bag, rows between two headers of a machine may be missing.
            numbers = self._conversions.numbers
            has_rows = self._soil.from_start or bool((numbers[:1] <= account.received + 1).all())
            if not new and has_rows and index >= self._window.first:
                self._check_header(account, header, event, int(self._soil.ticks[index]), last)
            if event.change is MembershipChange.JOINED:
                account.rejoin(header)
            else:
                account.update(header)
            self.num_headers += 1

    def _check_header(
        self,
        account: MachineAccountReplay,
        header: MachineHeader,
        event: MembershipEvent,
        tick: int,
        last: int,
    ) -> None:
        """Add a finding unless the header has the soil before plus the conversions since."""
        excess = header.soil_mm3 - account.expected(header.conversions_received)
        backwards = header.conversions_received < account.received
        ahead = header.conversions_received > last
        if not (excess or backwards or ahead):
            return
        self._num_wrong_headers += 1
        if self._num_wrong_headers > _MAX_FINDINGS:
            return
        when = "rejoining before" if event.change is MembershipChange.JOINED else "in"
        text = f"machine {header.machine_id} {when} tick {tick} "
        if backwards or ahead:
            text += (
                f"acknowledges conversions up to {header.conversions_received}, which is impossible"
            )
        else:
            text += (
                f"has {abs(excess)} mm3 too {'much' if excess > 0 else 'little'}:"
                f" {header.soil_mm3} mm3, where conversions"
                f" {account.received + 1}..{header.conversions_received} add up to"
                f" {header.soil_mm3 - excess} mm3"
            )
        self._result.findings.append(Finding(Check.ACCOUNTS, text, tick, tick))


def _released_volumes(
    soil: SoilTicks, conversions: NumberedRows, released: NDArray[np.bool_]
) -> dict[int, dict[int, int]]:
    """Return the volume of released soil [mm^3] by index of the soil tick and by machine id.

    Args:
        soil, conversions: the run.
        released: which conversion rows released soil, shape (rows,).
    """
    rows = conversions.rows[released]
    index = np.searchsorted(soil.spans[Stream.CONVERSION].last, conversions.numbers[released])
    volumes: dict[int, dict[int, int]] = {}
    for row, tick_index in zip(rows, index.tolist(), strict=True):
        machines = volumes.setdefault(tick_index, {})
        machine_id = int(row["machine_id"])
        machines[machine_id] = machines.get(machine_id, 0) + int(row["volume_mm3"])
    return volumes


def _compare_ledgers(
    result: AccountsAudit,
    ticks: Numbers,
    computed: Numbers,
    known: NDArray[np.bool_],
    start: int,
    ledgers: Mapping[int, Ledger],
) -> None:
    """Compare the recomputed accounts with the published ledgers.

    Args:
        result: receives the check and its findings.
        ticks: the audited ticks, shape (n,).
        computed: their accounts [mm^3], shape (n, 6).
        known: whether they are known, shape (n,).
        start: sum of all accounts when the run began [mm^3].
        ledgers: the published ledgers by tick.
    """
    if not ledgers:
        result.checks.append(CheckResult(Check.LEDGER, False, "the bag has no ledger"))
        return
    present = np.array([int(tick) in ledgers for tick in ticks])
    for first, last in contiguous_ranges(ticks[~present].tolist()):
        which = (
            f"ledger of tick {first} is"
            if first == last
            else f"ledgers of ticks {first}..{last} are"
        )
        text = f"the {which} missing"
        result.findings.append(Finding(Check.COMPLETENESS, text, first, last))
    compared = present & known
    published = [ledgers[int(tick)] for tick in ticks[compared]]
    for column, name in enumerate(ACCOUNTS):
        values = np.array([getattr(ledger, name) for ledger in published], dtype=np.int64)
        subject = f"the ledger's {name} differs"
        difference = values - computed[compared, column]
        finding = difference_finding(Check.LEDGER, subject, ticks[compared], difference)
        result.findings += [finding] if finding else []
    values = np.array([ledger.start for ledger in published], dtype=np.int64)
    finding = difference_finding(
        Check.LEDGER, "the ledger's start differs", ticks[compared], values - start
    )
    result.findings += [finding] if finding else []
    detail = f"{len(published)} ledgers, every account"
    result.checks.append(CheckResult(Check.LEDGER, bool(published), detail))

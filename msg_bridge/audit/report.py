"""What an audit of a bag ends with: which checks were made, what they found, and where."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

__all__ = ["AuditReport", "Check", "CheckResult", "Finding", "RunReport"]


class Check(Enum):
    """What an audit checks; the value is its name in reports."""

    COMPLETENESS = "completeness"
    """No row and no header is missing; what came twice is the same; headers count what is there."""
    TERRAIN = "terrain"
    """The total by conversion rows is the total cell by cell, at every tick."""
    KEYFRAMES = "keyframes"
    """Every terrain map is the first one with all changes since, cell by cell and in total."""
    ACCOUNTS = "accounts"
    """Every machine holds what its conversions make, and the sum of all accounts stays."""
    LEDGER = "ledger"
    """The published ledger is the one recomputed, in every account and at every tick."""
    DEPOSIT_REQUESTS = "deposit requests"
    """Each landed row has one answer of its volume; no particle is paid twice."""
    BACKLOG = "backlog rows"
    """A machine that returns is sent copies of the rows it lacks, and no others."""


@dataclass(frozen=True)
class Finding:
    """Something wrong.

    Attributes:
        check: which check found it.
        text: what is wrong, with its place.
        first_tick, last_tick: soil ticks concerned, None if they are not known.
    """

    check: Check
    text: str
    first_tick: int | None = None
    last_tick: int | None = None


@dataclass(frozen=True)
class CheckResult:
    """How far a check went.

    Attributes:
        done: whether it was made over all the ticks audited.
        detail: what was checked, or why it could not be.
    """

    check: Check
    done: bool
    detail: str


@dataclass(frozen=True)
class RunReport:
    """The audit of one run between resets.

    Attributes:
        epoch: its number.
        recorded: first and last soil tick in the bag; None if there is none.
        audited: first and last soil tick audited.
        rows: rows in the bag, each counted once, by stream.
        repeats: rows that came more than once, by stream.
        moved_mm3: volume of conversions in the ticks audited, by kind; RELEASED is the part of
            DEPOSIT and OUTSIDE that absent machines had left.
        keyframes: terrain maps checked, the first included.
        start_mm3: sum of all accounts at the first tick audited.
        max_imbalance_mm3: of all ticks audited; None if it could not be computed.
        max_imbalance_tick: where.
        checks: how far each check went.
        findings: what is wrong.
        notes: what else one should know.
    """

    run_id: int
    recorded: tuple[int, int] | None = None
    audited: tuple[int, int] | None = None
    rows: dict[str, int] = field(default_factory=dict)
    duplicates: dict[str, int] = field(default_factory=dict)
    moved_mm3: dict[str, int] = field(default_factory=dict)
    keyframes: int = 0
    start_mm3: int | None = None
    max_imbalance_mm3: int | None = None
    max_imbalance_tick: int | None = None
    checks: tuple[CheckResult, ...] = ()
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def ticks(self) -> int:
        """Number of ticks audited, from the first to the last."""
        return 0 if self.audited is None else self.audited[1] - self.audited[0] + 1

    @property
    def completeness_findings(self) -> tuple[Finding, ...]:
        """What is missing from the bag, or not what its headers say."""
        return tuple(f for f in self.findings if f.check is Check.COMPLETENESS)

    @property
    def disagreements(self) -> tuple[Finding, ...]:
        """What does not add up."""
        return tuple(f for f in self.findings if f.check is not Check.COMPLETENESS)

    @property
    def unchecked(self) -> tuple[CheckResult, ...]:
        """Checks that were not made over all ticks."""
        return tuple(each for each in self.checks if not each.done)

    @property
    def passed(self) -> bool:
        """Whether every check was made and found nothing."""
        return not self.findings and not self.unchecked and bool(self.checks)


@dataclass(frozen=True)
class AuditReport:
    """The audit of a bag.

    Attributes:
        path: the bag.
        messages: number of messages read.
        truncated: files that break off.
        runs: one report for each run in it.
        findings: what is wrong with the bag as a whole.
    """

    path: str
    messages: int
    truncated: tuple[str, ...]
    runs: tuple[RunReport, ...]
    findings: tuple[Finding, ...]

    @property
    def balanced(self) -> bool:
        """Whether nothing was found in what could be checked, a broken end apart."""
        return bool(self.runs) and not any(
            run_id.findings or run_id.max_imbalance_mm3 != 0 for run_id in self.runs
        )

    @property
    def passed(self) -> bool:
        """Whether the bag is whole, every check was made, and none found anything."""
        return not self.findings and bool(self.runs) and all(e.passed for e in self.runs)

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON has."""
        told: dict[str, Any] = _plain(asdict(self))
        told["passed"], told["balanced"] = self.passed, self.balanced
        for run_id, entry in zip(self.runs, told["runs"], strict=True):
            entry["ticks"], entry["passed"] = run_id.ticks, run_id.passed
        return told


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return value

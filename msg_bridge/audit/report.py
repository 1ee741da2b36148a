"""Result of an audit: which checks were made, what they found, and in which ticks."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

__all__ = ["AuditReport", "Check", "CheckResult", "Finding", "RunReport"]


class Check(Enum):
    """A check of an audit; its value is its name in reports."""

    COMPLETENESS = "completeness"
    """No row and no header is missing, repeats are equal, and headers count the recorded rows."""
    TERRAIN = "terrain"
    """Its volume by conversion rows equals its volume cell by cell, at every tick."""
    KEYFRAMES = "keyframes"
    """Every terrain map equals the one before plus all updates since, in every cell."""
    ACCOUNTS = "accounts"
    """Every machine has the soil of its conversions, and the sum of all accounts is constant."""
    LEDGER = "ledger"
    """The published ledger equals the recomputed accounts, at every tick."""
    DEPOSIT_REQUESTS = "deposit requests"
    """Each deposit request has one answer of its volume; no particle is deposited twice."""
    BACKLOG = "backlog rows"
    """A machine that rejoins receives exact copies of the conversion rows that it lacks."""


@dataclass(frozen=True)
class Finding:
    """A fault.

    Attributes:
        check: the check that found it.
        text: what is wrong, and where.
        first_tick, last_tick: the soil ticks concerned, None if unknown.
    """

    check: Check
    text: str
    first_tick: int | None = None
    last_tick: int | None = None


@dataclass(frozen=True)
class CheckResult:
    """Extent of a check.

    Attributes:
        check: the check.
        done: whether it covered all audited ticks.
        detail: what was checked, or why it could not be.
    """

    check: Check
    done: bool
    detail: str


@dataclass(frozen=True)
class RunReport:
    """Audit of one run (between two resets).

    Attributes:
        run_id: number of the run.
        recorded: first and last soil tick in the bag; None if there is none.
        audited: first and last audited soil tick; None if there is none.
        rows: number of different rows in the bag, by stream.
        duplicates: number of rows that were received again, by stream.
        moved_mm3: volume of the conversions in the audited ticks, by kind. RELEASED is the part of
            DEPOSIT and OUTSIDE that was soil of absent machines.
        keyframes: number of checked terrain maps, the first included.
        start_mm3: sum of all accounts at the first audited tick; None if unknown.
        max_imbalance_mm3: the largest of all audited ticks, signed; None if it was not computed.
        max_imbalance_tick: its tick.
        checks: extent of each check.
        findings: all faults.
        notes: limits of the audit that are no faults.
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
        """Number of audited ticks."""
        return 0 if self.audited is None else self.audited[1] - self.audited[0] + 1

    @property
    def unchecked(self) -> tuple[CheckResult, ...]:
        """Checks that did not cover all audited ticks."""
        return tuple(each for each in self.checks if not each.done)

    @property
    def passed(self) -> bool:
        """Whether every check covered all ticks and found nothing."""
        return not self.findings and not self.unchecked and bool(self.checks)


@dataclass(frozen=True)
class AuditReport:
    """Audit of a bag.

    Attributes:
        path: the bag.
        messages: number of messages read.
        truncated: names of files without an end.
        runs: one report for each run in the bag.
        findings: faults of the bag as a whole.
    """

    path: str
    messages: int
    truncated: tuple[str, ...]
    runs: tuple[RunReport, ...]
    findings: tuple[Finding, ...]

    @property
    def balanced(self) -> bool:
        """Whether the checks that could be made found nothing; a truncated file does not count."""
        return bool(self.runs) and not any(
            run.findings or run.max_imbalance_mm3 != 0 for run in self.runs
        )

    @property
    def passed(self) -> bool:
        """Whether the bag is complete, and every check covered all ticks and found nothing."""
        return not self.findings and bool(self.runs) and all(run.passed for run in self.runs)

    def to_dict(self) -> dict[str, Any]:
        """Return all attributes, `ticks`, `passed` and `balanced`, in types of JSON."""
        content: dict[str, Any] = _to_json_types(asdict(self))
        content["passed"], content["balanced"] = self.passed, self.balanced
        for run, entry in zip(self.runs, content["runs"], strict=True):
            entry["ticks"], entry["passed"] = run.ticks, run.passed
        return content


def _to_json_types(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, dict):
        return {key: _to_json_types(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_to_json_types(each) for each in value]
    return value

"""Helpers to inspect audit reports and to select messages of a recording by tick."""

from __future__ import annotations

from collections.abc import Callable

from msg_bridge.audit.report import AuditReport, Check
from msg_bridge.contract.messages import Verb


def finding_texts(report: AuditReport, check: Check) -> str:
    """Return the findings of a check in all runs, one per line."""
    findings = [f for run in report.runs for f in run.findings if f.check is check]
    return "\n".join(f.text for f in findings)


def failed_checks(report: AuditReport) -> set[Check]:
    """Return the checks with findings in any run."""
    return {f.check for run in report.runs for f in run.findings}


def has_tick(tick: int) -> Callable[[object], bool]:
    """Return whether a header, other than a join, or a ledger is of a tick."""
    return lambda header: (
        getattr(header, "tick", None) == tick
        and getattr(header, "verb", Verb.STEP) is not Verb.JOIN
    )

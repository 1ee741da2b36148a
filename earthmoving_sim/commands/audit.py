"""Audit a recording: was a cubic millimetre of soil lost, created or deposited twice, at any tick?

Recomputes all accounts of soil from the rows, headers and terrain maps in the bag alone, and
compares them with the published ledger. Reports what is missing, where, and what could not be
checked. Exits with 0 if the bag is complete and every check covered all ticks and found nothing,
else with 1.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from msg_bridge.count_text import count_text

if TYPE_CHECKING:
    from msg_bridge.audit.report import AuditReport, RunReport

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "recompute from a bag where all soil was at every tick, to the mm3"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `earthmoving audit`."""
    parser.add_argument("bag", type=Path, help="folder of a bag, or an .mcap file")
    parser.add_argument(
        "--namespace", help="namespace of the simulation; needed if the bag has several"
    )
    parser.add_argument("--json", action="store_true", help="print the whole report as JSON")


def run(args: argparse.Namespace) -> int:
    """Audit the bag and print the report; return 0 if it passed, else 1."""
    from earthmoving_sim.reading_progress import reading_progress
    from msg_bridge.audit.bag_audit import audit_bag

    report = audit_bag(args.bag, reading_progress(), namespace=args.namespace)
    if args.json:
        print(json.dumps(report.to_dict(), indent=2))
    else:
        print("\n".join(_lines(report)))
    return 0 if report.passed else 1


def _lines(report: "AuditReport") -> Iterator[str]:
    """Yield the lines of the printed report."""
    yield f"{report.path}: {count_text(report.messages, 'message')}"
    for finding in report.findings:
        yield f"  ✗ {finding.text}"
    for run in report.runs:
        yield ""
        yield from _run_lines(run)
    yield ""
    if report.passed:
        yield "Passed: every check was made, and not 1 mm3 is missing or too much."
    elif report.balanced:
        yield "Not passed: what could be checked adds up, but see ✗ and ? above."
    else:
        yield "Failed: see ✗ and ? above."


def _run_lines(run: "RunReport") -> Iterator[str]:
    yield f"run {run.run_id}"
    if run.audited is not None:
        yield f"  ticks     {run.ticks:,}, from {run.audited[0]} to {run.audited[1]}"
    for name, count in run.rows.items():
        duplicates = run.duplicates.get(name, 0)
        repeated = f", {duplicates:,} duplicates" if duplicates else ""
        yield f"  rows      {name.lower():<16}{count:>14,}{repeated}"
    for name, volume in run.moved_mm3.items():
        if volume:
            yield f"  moved     {name.lower():<16}{volume:>22,} mm3"
    if run.max_imbalance_mm3 is None:
        yield "  imbalance not computed"
    else:
        tick = f" (tick {run.max_imbalance_tick})" if run.max_imbalance_mm3 else ""
        yield f"  imbalance {run.max_imbalance_mm3:+,} mm3 at most, over all ticks{tick}"
    failed = {finding.check for finding in run.findings}
    for check in run.checks:
        sign = "✗" if check.check in failed else "✓" if check.done else "?"
        done = "" if check.done else "not checked in full: "
        yield f"  {sign} {check.check.value:<16} {done}{check.detail}"
    for finding in run.findings:
        yield f"  → {finding.check.value}: {finding.text}"
    for note in run.notes:
        yield f"  note: {note}"

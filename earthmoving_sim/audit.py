"""Audit a recording: was one cubic millimetre of soil lost, made, or paid twice, at any tick?

Recomputes every account of soil from the rows, headers and terrain maps in the bag alone, and
compares with the ledger that was published. Says what is missing, where, and what could not be
checked. Exits with 0 if the bag is whole and every check was made and found nothing, else with 1.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from msg_bridge.audit.report import AuditReport, RunReport

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "recompute from a bag where every mm3 of soil was, at every tick"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The audit's options."""
    parser.add_argument("bag", type=Path, help="a bag's folder, or an .mcap file")
    parser.add_argument("--json", action="store_true", help="print the whole report as JSON")


def run(args: argparse.Namespace) -> int:
    """Audit and print; 0 if sound, else 1."""
    from msg_bridge.audit.bag_audit import audit_bag

    report = audit_bag(args.bag, _progress() if sys.stderr.isatty() else None)
    if args.json:
        print(json.dumps(report.to_dict(), indent=2))
    else:
        print("\n".join(_lines(report)))
    return 0 if report.passed else 1


def _progress() -> Callable[[float], None]:
    def show(part: float) -> None:
        end = "\n" if part >= 1.0 else "\r"
        print(f"  reading {100.0 * part:3.0f} %", end=end, file=sys.stderr, flush=True)

    return show


def _lines(report: "AuditReport") -> Iterator[str]:
    """The report, to read."""
    yield f"{report.path}: {report.messages:,} messages"
    for finding in report.findings:
        yield f"  ✗ {finding.text}"
    for epoch in report.runs:
        yield ""
        yield from _run_lines(epoch)
    yield ""
    if report.passed:
        yield "Sound: every check was made, and not 1 mm3 is missing or too much."
    elif report.balanced:
        yield "Not sound as a whole: what could be checked adds up, but see ✗ and ? above."
    else:
        yield "Not sound: see ✗ and ? above."


def _run_lines(epoch: "RunReport") -> Iterator[str]:
    yield f"epoch {epoch.run_id}"
    if epoch.audited is not None:
        yield f"  ticks     {epoch.ticks:,}, from {epoch.audited[0]} to {epoch.audited[1]}"
    for name, count in epoch.rows.items():
        again = epoch.duplicates.get(name, 0)
        came = f", {again:,} of them came again" if again else ""
        yield f"  rows      {name.lower():<12}{count:>14,}{came}"
    for name, volume in epoch.moved_mm3.items():
        if volume:
            yield f"  moved     {name.lower():<12}{volume:>22,} mm3"
    if epoch.max_imbalance_mm3 is None:
        yield "  imbalance not computed"
    else:
        where = f" (tick {epoch.max_imbalance_tick})" if epoch.max_imbalance_mm3 else ""
        yield f"  imbalance {epoch.max_imbalance_mm3:+,} mm3 at worst, in any tick{where}"
    failed = {finding.check for finding in epoch.findings}
    for check in epoch.checks:
        sign = "✗" if check.check in failed else "✓" if check.done else "?"
        done = "" if check.done else "not checked in full: "
        yield f"  {sign} {check.check.value:<13} {done}{check.detail}"
    for finding in epoch.findings:
        yield f"  → {finding.check.value}: {finding.text}"
    for note in epoch.notes:
        yield f"  note: {note}"

"""The tables of docs/bags.md agree with the code."""

import re
from dataclasses import fields
from pathlib import Path

from dig_operator import CycleReport
from msg_bridge.audit.report import AuditReport, Check, CheckResult, Finding, RunReport

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/bags.md").read_text(encoding="utf-8")


def table_after(text: str) -> list[list[str]]:
    """Return the cells of the first table after a text, without its title."""
    lines = PAGE[PAGE.index(text) :].splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("|---"))
    rows = []
    for line in lines[start + 1 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def names(cell: str) -> list[str]:
    """Return the names in back quotes of a cell."""
    return re.findall(r"`([^`]+)`", cell)


def test_keys_of_a_cycle_are_those_of_its_report() -> None:
    keys = {name for row in table_after("`<m>/operator/cycles`: ") for name in names(row[0])}
    assert keys == {field.name for field in fields(CycleReport)}


def test_checks_and_json_keys_are_those_of_the_audit() -> None:
    checks = [name for row in table_after("## The audit") for name in names(row[0])]
    assert checks == [check.value for check in Check]
    finding = Finding(Check.LEDGER, "")
    run = RunReport(1, checks=(CheckResult(Check.LEDGER, True, ""),), findings=(finding,))
    content = AuditReport("", 0, (), (run,), ()).to_dict()
    introduction = PAGE[
        PAGE.index("`--json` prints") : PAGE.index("a list with one object per run")
    ]
    assert set(names(introduction)) == {*content, "--json"}
    rows = {name for row in table_after("`--json` prints") for name in names(row[0])}
    (entry,) = content["runs"]
    assert rows == set(entry)
    for key in ("checks", "findings"):
        (text,) = [row[1] for row in table_after("`--json` prints") if names(row[0]) == [key]]
        assert set(names(text)) == set(entry[key][0])

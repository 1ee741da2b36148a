"""Sections of the page on the run as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import yaml

from earthmoving_sim.run_report.page import Page
from earthmoving_sim.run_report.run_data import RunData
from earthmoving_sim.run_report.summary import RunSummary
from msg_bridge.bag.reader import BagReader
from msg_bridge.yaml_text import load_yaml

__all__ = ["add_overview", "add_problems", "add_setup", "add_timing"]

_LEVELS = {1: "warning", 2: "error", 3: "stale"}
_SIM_TIME_LIMIT = 10**17
"""Log time below which log times are simulation times [ns]."""
_MAX_PROBLEMS = 40
_REJECTED = ("reject", "refus", "malformed", "ignored")
"""Parts of the names of diagnostics that count inputs which were not accepted."""


def add_overview(
    page: Page, reader: BagReader, run: RunData, summary: RunSummary, run_ids: list[int]
) -> None:
    """Add the figures of the run."""
    figures = []
    if run.first_time is not None:
        figures.append((f"{summary.simulated_time:.1f} s", "simulated time"))
    figures.append((f"{summary.wall_time:.1f} s", "recorded log time"))
    for name, machine in summary.machines.items():
        total = machine.total
        if total is not None:
            figures.append((f"{total.volume:.2f} m³", f"moved by {name} in {total.count} cycles"))
    if summary.excavated:
        part = " in the bag" if summary.earlier_conversions or summary.missing_conversions else ""
        figures.append(
            (f"{sum(summary.excavated.values()):.2f} m³", f"loosened{part}, bank volume")
        )
    if summary.max_imbalance is not None:
        figures.append((f"{summary.max_imbalance:+d} mm³", "largest imbalance"))
    if summary.late_ticks is not None:
        figures.append((str(summary.late_ticks), "late ticks"))
    page.figures(figures)
    rows = [("begin", _log_time(run.first_log))]
    if run.run_id is not None:
        others = [str(each) for each in run_ids if each != run.run_id]
        more = f" (the bag also has {', '.join(others)})" if others else ""
        rows.append(("run", f"{run.run_id}{more}"))
    if run.first_tick and run.first_time is not None:
        rows.append(("begins within the run", f"at tick {run.first_tick}, {run.first_time:.2f} s"))
    rows.append(("machines", ", ".join(summary.machines) or "none"))
    lost = _lost_messages(reader.path)
    rows.append(("lost by the recorder", lost or "nothing"))
    if reader.truncated:
        rows.append(("files without an end", ", ".join(reader.truncated)))
    if run.malformed:
        malformed = ", ".join(f"{count} on {topic}" for topic, count in run.malformed.items())
        rows.append(("messages that cannot be read", malformed))
    page.table(("", ""), rows, has_texts=True)


def add_timing(page: Page, run: RunData, summary: RunSummary) -> None:
    """Add how the run kept real time, and pauses."""
    rows = []
    config = _section(run.configs.get("/sim", {}), "run")
    if "sync" in config:
        rows.append(("synchronisation", str(config["sync"])))
    if summary.wall_time > 0.0 and run.first_time is not None:
        factor = summary.simulated_time / summary.wall_time
        rows.append(("mean real-time factor", f"{factor:.2f}"))
    for name, values in sorted(run.diagnostics.items()):
        rows += [
            (f"{name}: {key.replace('_', ' ')}", values[key])
            for key in ("late_ticks", "lost_time_s", "skipped_ticks", "late_ticks_by_machine")
            if key in values
        ]
    for number, (time, is_paused) in enumerate(run.paused):
        if number or is_paused:
            rows.append((f"at {time:.1f} s", "paused" if is_paused else "continued"))
    if rows:
        page.table(("", ""), rows, has_texts=True)
    else:
        page.note("The bag has neither a ledger nor diagnostics of a soil node.")


def add_problems(page: Page, reader: BagReader, run: RunData) -> None:
    """Add rejected inputs, and what nodes reported."""
    page.section("Rejected inputs and problems")
    rows = [
        (name, key.replace("_", " "), value)
        for name, values in sorted(run.diagnostics.items())
        for key, value in values.items()
        if any(part in key for part in _REJECTED) and value not in ("0", "none", "")
    ]
    if rows:
        page.heading("Inputs that were not accepted")
        page.table(("node", "what", "number or reason"), rows, has_texts=True)
    if run.rejections:
        page.heading("Rejected machines")
        reasons = {text: run.rejections.count(text) for text in dict.fromkeys(run.rejections)}
        page.table(
            ("reason", "number"),
            [(text, str(count)) for text, count in reasons.items()],
            has_texts=True,
        )
    problems = run.problems.by_severity()
    if problems:
        page.heading("Reported by nodes")
        page.table(
            ("node", "level", "last message of this level", "reports", "first [s]", "last [s]"),
            [
                (
                    each.source,
                    _LEVELS.get(each.level, str(each.level)),
                    each.text,
                    str(each.num_reports),
                    f"{each.first:.1f}",
                    f"{each.last:.1f}",
                )
                for each in problems[:_MAX_PROBLEMS]
            ],
            has_texts=True,
        )
        more = len(problems) - _MAX_PROBLEMS
        page.note(
            "Reports that differ in numbers only are one row, with the highest level. Times are"
            " log times from the first message on."
            + (f" {more} more problems are left out." if more > 0 else "")
        )
    if not run.diagnostics:
        page.note("The bag has no /diagnostics.")
    elif not (rows or run.rejections or problems):
        page.note("No node rejected an input or reported a problem.")


def add_setup(page: Page, run: RunData) -> None:
    """Add parameters, seeds, files and versions."""
    page.section("Setup")
    if not run.configs:
        page.note("The bag has no configurations (/sim/config, <m>/config).")
        return
    for name, config in sorted(run.configs.items()):
        page.heading("soil" if name == "/sim" else name)
        rows = [
            (key, _text(value))
            for key, value in config.items()
            if key not in ("versions", "input_files", "soil_kinds") and value not in (None, [], {})
        ]
        page.table(("section", "parameters"), rows, has_texts=True)
        files = config.get("input_files") or []
        if files:
            page.table(
                ("file", "parameter", "SHA-256"),
                [
                    (str(each["path"]), str(each["parameter"]), str(each["sha256"])[:16] + "...")
                    for each in files
                    if isinstance(each, dict) and {"path", "parameter", "sha256"} <= set(each)
                ],
                has_texts=True,
            )
        versions = config.get("versions")
        if isinstance(versions, dict):
            page.note("Versions: " + ", ".join(f"{k} {v}" for k, v in versions.items()))


def _section(config: Mapping[str, Any], section: str) -> Mapping[str, Any]:
    found = config.get(section)
    return found if isinstance(found, dict) else {}


def _text(value: Any) -> str:
    """Return a section of a configuration in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{k}: {_text(v)}" for k, v in value.items() if v not in ("", None, []))
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    return str(value)


def _log_time(nanoseconds: int | None) -> str:
    if nanoseconds is None:
        return "no messages"
    if nanoseconds < _SIM_TIME_LIMIT:
        return f"{nanoseconds * 1e-9:.3f} s of simulation time"
    time = datetime.fromtimestamp(nanoseconds * 1e-9, timezone.utc)
    return f"{time:%Y-%m-%d %H:%M:%S} UTC"


def _lost_messages(path: Path) -> str:
    """Return what the recorder lost, by its metadata.yaml; empty for nothing, or if unknown."""
    metadata = path / "metadata.yaml"
    try:
        information = load_yaml(metadata.read_text())["rosbag2_bagfile_information"]
        lost = json.loads((information.get("custom_data") or {}).get("lost", "{}"))
        return ", ".join(f"{count} on {topic}" for topic, count in lost.items())
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError):
        return "unknown: the bag has no metadata.yaml"

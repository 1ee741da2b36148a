"""Read a bag, and write its report as a page and pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from earthmoving_sim.pictures.cut_fill import draw_cut_fill
from earthmoving_sim.pictures.site_record import SiteRecord
from earthmoving_sim.run_report.charts import Line, Panel, draw_panels
from earthmoving_sim.run_report.machine_charts import draw_machine_charts
from earthmoving_sim.run_report.machine_section import add_machine
from earthmoving_sim.run_report.page import GENERATOR, Page
from earthmoving_sim.run_report.production import MIN_RATE_STEPS, RATE_WINDOWS, add_production
from earthmoving_sim.run_report.reading import read_runs
from earthmoving_sim.run_report.run_data import RunData
from earthmoving_sim.run_report.run_sections import (
    add_overview,
    add_problems,
    add_setup,
    add_timing,
)
from earthmoving_sim.run_report.summary import RunSummary, summarise
from msg_bridge.bag.atomic_file import BagError, write_error
from msg_bridge.bag.output_path import describe_obstacle
from msg_bridge.bag.reader import BagReader

__all__ = ["Report", "signed_volume", "write_report"]

_PAGE = "index.html"


@dataclass(frozen=True)
class Report:
    """A written report.

    Attributes:
        page: the HTML file.
        summary: its figures.
        run_ids: numbers of all runs in the bag.
        malformed: number of messages that cannot be read, by topic.
    """

    page: Path
    summary: RunSummary
    run_ids: list[int]
    malformed: dict[str, int]


def write_report(
    reader: BagReader,
    folder: Path,
    *,
    title: str = "",
    run_id: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Report:
    """Write the report on a run of a bag.

    Args:
        reader: the bag.
        folder: folder of the page (`index.html`) and the pictures, empty or missing; those of a
            former report are replaced.
        title: heading; by default the name of the bag.
        run_id: number of the run; None: the last one.
        progress: is called with the fraction of the bag that has been read.

    Raises:
        BagReadError: the bag is damaged.
        BagError: the folder has other files, or the report cannot be written.
    """
    _check_folder(folder)
    run, run_ids = read_runs(reader, run_id=run_id, progress=progress)
    if run_id is not None and run_ids and run_id not in run_ids:
        names = ", ".join(map(str, run_ids))
        raise BagError(f"{reader.path} has no run {run_id}; it has {names}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        page = folder / _PAGE
        # A report that is interrupted can be written again into the same folder.
        page.write_text(_unfinished_page(reader), encoding="utf-8")
        summary = summarise(run)
        content = _page(reader, run, summary, run_ids, folder, title)
        page.write_text(content.html(), encoding="utf-8")
    except OSError as error:
        raise write_error(folder, error) from error
    return Report(page, summary, run_ids, dict(run.malformed))


def _check_folder(folder: Path) -> None:
    """Check that a folder is missing, is empty or has a report.

    Raises:
        BagError: it has something else.
    """
    obstacle = describe_obstacle(folder)
    if obstacle:
        raise BagError(obstacle)
    if not folder.exists():
        return
    existing = next(folder.iterdir(), None)
    if existing is not None and not _has_report(folder):
        raise BagError(
            f"{folder} is not empty (it has {existing.name}), and has no report that could be"
            " replaced; give another by --output"
        )


def _has_report(folder: Path) -> bool:
    try:
        return GENERATOR in (folder / _PAGE).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


def _unfinished_page(reader: BagReader) -> str:
    page = Page("Report", str(reader.path))
    page.note("This report was not finished.")
    return page.html()


def _page(
    reader: BagReader,
    run: RunData,
    summary: RunSummary,
    run_ids: list[int],
    folder: Path,
    title: str,
) -> Page:
    page = Page(title or f"Report on {reader.path.resolve().name}", str(reader.path))
    add_overview(page, reader, run, summary, run_ids)
    _add_terrain(page, run, summary, folder)
    _add_accounts(page, run, summary, folder)
    for name, machine in summary.machines.items():
        data = run.machines[name]
        charts = draw_machine_charts(name, data, machine, folder)
        add_machine(page, name, data, machine, charts)
    _add_clock(page, run, summary, folder)
    add_problems(page, reader, run)
    add_setup(page, run)
    return page


def _add_terrain(page: Page, run: RunData, summary: RunSummary, folder: Path) -> None:
    page.section("Terrain")
    terrain = run.terrain
    if terrain.grid is None or summary.cut is None or summary.fill is None:
        updates = " It has updates of one, which are not enough." if terrain.has_updates else ""
        page.note(f"The bag has no terrain map.{updates}")
        return
    if summary.cut + summary.fill > 0.0:
        record = SiteRecord(
            grid=terrain.grid,
            before=terrain.before,
            after=terrain.after,
            loose_depth=terrain.loose_depth,
            lip_path=np.zeros((0, 3)),
            lip_cycle=np.zeros(0, dtype=np.int64),
            lip_phase=np.zeros(0, dtype=np.str_),
            machine_outline=[],
            title="Cut and fill",
        )
        page.picture(draw_cut_fill(record, folder / "cut_fill.png"), "Cut and fill")
    else:
        page.note("No column has changed.")
    rows = [
        ("cut", f"{summary.cut:.3f}"),
        ("fill", f"{summary.fill:.3f}"),
        ("fill - cut", signed_volume(summary.fill - summary.cut)),
    ]
    rows += [
        (f"design: {name.replace('_', ' ')}", f"{value:.3f}")
        for name, value in summary.design.items()
    ]
    page.table(("", "m³ bank"), rows)
    page.note(
        "Cut and fill are sums of bank volume over the columns that hold less, or more, at the end"
        " than at the begin; the volumes in the picture are those between the surfaces, in which"
        " loose soil takes more room."
    )
    if terrain.start_revision > 0:
        page.note(
            f"The first terrain map in the bag is of {terrain.start_time:.2f} s, after the terrain"
            f" had changed in {terrain.start_revision:,} ticks: cut and fill are those since then."
            " What was before is not known."
        )


def signed_volume(volume: float) -> str:
    """Return a volume [m^3] with its sign, with at least two significant digits."""
    decimals = 3 if volume == 0.0 else max(3, 1 - math.floor(math.log10(abs(volume))))
    return f"{volume:+.{decimals}f}"


def _add_accounts(page: Page, run: RunData, summary: RunSummary, folder: Path) -> None:
    page.section("Where the soil is")
    if run.accounts:
        _add_ledger(page, run, folder)
    else:
        page.note("The bag has no ledger (/soil/ledger).")
    if run.excavated or run.deposited:
        add_production(page, run, folder)
    if summary.earlier_conversions:
        page.note(
            f"The bag lacks the first {summary.earlier_conversions:,} conversion rows of the run:"
            " what was loosened and deposited before the recording is not in these volumes."
        )
    if summary.missing_conversions:
        page.note(
            f"The bag lacks {summary.missing_conversions:,} conversion rows within the recording,"
            " so these volumes are too small; `earthmoving audit` names the ticks."
        )


def _add_ledger(page: Page, run: RunData, folder: Path) -> None:
    """Add the accounts of the ledger over time."""

    def lines(*names: str) -> list[Line]:
        return [
            Line(name.replace("_", " "), run.accounts[name].times, run.accounts[name].values)
            for name in names
            if name in run.accounts
        ]

    moving = lines("particles", "pending", "in_flight", "absent")
    panels = [
        Panel("not in the terrain\n[m³ bank]", moving, is_stacked=True),
        Panel("terrain since\nthe start [m³]", lines("terrain")),
        Panel("outside the\nmap [m³]", lines("outside")),
        Panel("imbalance\n[mm³]", [Line("", run.imbalance.times, run.imbalance.values)]),
    ]
    page.picture(
        draw_panels(
            folder / "accounts.png",
            "Accounts of the soil",
            "From the ledger of every tick.",
            panels,
        ),
        "Accounts of the soil",
    )


def _add_clock(page: Page, run: RunData, summary: RunSummary, folder: Path) -> None:
    page.section("Real time")
    panels = []
    if len(run.clock) > MIN_RATE_STEPS:
        edges = np.linspace(run.clock.times[0], run.clock.times[-1], RATE_WINDOWS + 1)
        simulated = np.interp(edges, run.clock.times, run.clock.values)
        factors = np.diff(simulated) / np.maximum(np.diff(edges), 1e-9)
        panels.append(
            Panel("real-time\nfactor [1]", [Line("", 0.5 * (edges[1:] + edges[:-1]), factors)])
        )
    if len(run.late_ticks):
        panels.append(
            Panel("late ticks\nso far", [Line("", run.late_ticks.times, run.late_ticks.values)])
        )
    if panels:
        page.picture(
            draw_panels(
                folder / "real_time.png",
                "Real time",
                "Simulation time over log time, and late ticks of the soil node.",
                panels,
                time_label="log time since the begin [s]",
            ),
            "Real-time factor and late ticks",
        )
    add_timing(page, run, summary)

"""Volumes that machines loosened and deposited over the time of the recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from earthmoving_sim.run_report.charts import Line, Panel, draw_panels
from earthmoving_sim.run_report.page import Page
from earthmoving_sim.run_report.run_data import RunData
from earthmoving_sim.run_report.trace import Trace

__all__ = ["MIN_RATE_STEPS", "RATE_WINDOWS", "add_production", "rate_lines", "total_lines"]

MIN_RATE_STEPS = 30
"""Number of samples below which no rate is drawn."""
RATE_WINDOWS = 60
"""Intervals of a recording over each of which a rate is taken."""
_HOUR = 3600.0


def add_production(page: Page, run: RunData, folder: Path) -> None:
    """Add the volumes of the conversion rows over the time of the recording."""
    span = run.time_span
    panels = [
        Panel("excavated\n[m³ bank]", total_lines(run.excavated, span)),
        Panel("excavation\n[m³/h]", rate_lines(run.excavated, span)),
        Panel("deposited\n[m³ bank]", total_lines(run.deposited, span)),
    ]
    page.picture(
        draw_panels(
            folder / "production.png",
            "Production",
            "Soil loosened and become terrain again, by the conversion rows of each machine.",
            [panel for panel in panels if panel.lines],
            limits=span if span[1] > span[0] else None,
        ),
        "Production",
    )


def total_lines(totals: Mapping[int, Trace], span: tuple[float, float]) -> list[Line]:
    """Return the total volume of each machine over a time [s]; it is constant between rows."""
    lines = []
    for number, trace in sorted(totals.items()):
        # Rows that were sent again may have the time of later ones.
        recorded = np.maximum.accumulate(trace.times)
        times = np.array([min(span[0], recorded[0]), *recorded, max(span[1], recorded[-1])])
        values = np.array([0.0, *trace.values, trace.values[-1]])
        lines.append(Line(f"machine {number}", times, values))
    return lines


def rate_lines(totals: Mapping[int, Trace], span: tuple[float, float]) -> list[Line]:
    """Return the volume per hour in each of some intervals of a time [s]."""
    lines = []
    for line in total_lines(totals, span):
        first, last = float(line.times[0]), float(line.times[-1])
        if line.times.size < MIN_RATE_STEPS or last <= first:
            continue
        edges = np.linspace(first, last, RATE_WINDOWS + 1)
        volume = line.values[np.searchsorted(line.times, edges, side="right") - 1]
        rates = np.diff(volume) / np.diff(edges) * _HOUR
        lines.append(Line(line.name, 0.5 * (edges[1:] + edges[:-1]), rates))
    return lines

"""Section of the page on a machine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from earthmoving_sim.run_report.page import Page
from earthmoving_sim.run_report.run_data import MachineData
from earthmoving_sim.run_report.summary import MachineSummary

__all__ = ["add_machine"]

_MAX_ROWS = 200
_PARTS = ("return", "dig", "lift", "swing", "dump")
_MILLI = 1e3


def add_machine(
    page: Page,
    name: str,
    data: MachineData,
    summary: MachineSummary,
    charts: Mapping[str, Path],
) -> None:
    """Add what a machine did.

    Args:
        page: the page.
        name: namespace of the machine.
        data, summary: the machine.
        charts: its pictures by what they show.
    """
    page.section(f"Machine {name or '/'}")
    _add_figures(page, summary)
    if not len(data.payload):
        page.note("Its payload is not recorded, so there are no cycles.")
    elif not summary.cycles:
        page.note(
            "No cycle is recorded as a whole: the payload never rose above 30 % of its largest"
            " value and then fell below 15 %, or was above at the begin of the recording."
        )
    _add_cycles(page, summary)
    for kind, path in charts.items():
        page.picture(path, f"{name}: {kind}")
    _add_latency(page, data, summary)
    _add_reports(page, summary)


def _add_figures(page: Page, summary: MachineSummary) -> None:
    figures = []
    total = summary.total
    if total is not None:
        figures += [
            (str(total.count), "cycles"),
            (f"{total.volume:.2f} m³", "moved, bank volume"),
            (f"{total.mean_volume:.3f} m³", "per cycle"),
            (f"{total.median_duration:.1f} s", "median cycle time"),
            (f"{total.productivity:.0f} m³/h", "productivity in the cycles"),
        ]
    if summary.max_payload > 0.0:
        figures.append((f"{summary.max_payload:.3f} m³", "largest payload, bank volume"))
    for tool, force in summary.max_forces.items():
        figures.append((f"{force / _MILLI:.0f} kN", f"largest force on {tool}"))
    if summary.distance > 0.0:
        figures.append((f"{summary.distance:.1f} m", "way"))
    if figures:
        page.figures(figures)
    if summary.reported_summary is not None:
        page.note(
            "Volume and durations of the cycles are those that the operator reported: it takes the"
            " payload above the dump, and what is left after."
        )


def _add_cycles(page: Page, summary: MachineSummary) -> None:
    if not summary.cycles:
        return
    page.heading("Cycles")
    rows = [
        (
            str(number),
            f"{cycle.start:.1f}",
            *(f"{getattr(cycle, f'{part}_time'):.1f}" for part in _PARTS),
            f"{cycle.duration:.1f}",
            f"{cycle.volume:.3f}",
            f"{cycle.productivity:.0f}",
        )
        for number, cycle in enumerate(summary.cycles[:_MAX_ROWS], start=1)
    ]
    header = ("", "begin [s]", *(f"{part} [s]" for part in _PARTS))
    page.table((*header, "cycle [s]", "m³ bank", "m³/h"), rows)
    if len(summary.cycles) > _MAX_ROWS:
        page.note(f"The first {_MAX_ROWS} of {len(summary.cycles)} cycles.")
    if summary.phase_times:
        times = ", ".join(f"{part} {summary.phase_times[part]:.1f} s" for part in _PARTS)
        page.note(f"Mean times by the phases of the operator: {times}.")
    page.note(
        "From the payload, also where an operator reported its cycles, from which these differ by"
        " some per cent: it digs until 95 % of the cycle's largest payload, and dumps when the"
        " payload falls below 90 % of what is carried, the median after the dig; it swings from"
        " 0.05 rad/s on."
    )


def _add_latency(page: Page, data: MachineData, summary: MachineSummary) -> None:
    if summary.latency is None:
        if data.latency.num_commands:
            page.note("No change of the applied commands follows the commands in the bag.")
        return
    latency = summary.latency
    rows = [
        ("commands with an effect", f"{latency.count} of {data.latency.num_commands}"),
        ("median", f"{latency.median * _MILLI:.1f} ms"),
        ("95 %", f"{latency.p95 * _MILLI:.1f} ms"),
        ("largest", f"{latency.max * _MILLI:.1f} ms"),
    ]
    if latency.simulated_median is not None:
        rows.append(("median in simulation time", f"{latency.simulated_median * _MILLI:.1f} ms"))
    page.heading("Latency of commands")
    page.table(("", ""), rows)


def _add_reports(page: Page, summary: MachineSummary) -> None:
    if not summary.reported:
        return
    page.heading("Reported by the operator")
    keys = list(dict.fromkeys(key for report in summary.reported for key in report))
    rows = [[_number(report.get(key)) for key in keys] for report in summary.reported[:_MAX_ROWS]]
    page.table([key.replace("_", " ") for key in keys], rows)


def _number(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)

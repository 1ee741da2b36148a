"""Pictures of values over time, in panels that share the time axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from earthmoving_sim.pictures.style import (
    GREY,
    INK,
    LABEL,
    SMALL,
    add_axes,
    add_title,
    new_figure,
    save,
)

__all__ = ["COLOURS", "Line", "Panel", "Span", "draw_histogram", "draw_panels", "draw_path"]

COLOURS = ("#1f5c99", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#6b7078")
"""Colours of lines in turn (Okabe and Ito), the first as that of fill."""

_WIDTH, _PANEL, _GAP = 10.0, 1.55, 0.34  # [in]
_LEFT, _RIGHT, _BELOW, _ABOVE = 0.95, 1.55, 0.6, 0.95
_MAX_LEGEND = 9
_SPAN_COLOUR = "#e9edf2"


@dataclass(frozen=True)
class Line:
    """A line: name in the legend, times [s], values, and whether it is dashed."""

    name: str
    times: NDArray[np.float64]
    values: NDArray[np.float64]
    is_dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """A panel.

    Attributes:
        label: quantity and unit of its axis.
        lines: its lines.
        is_stacked: whether the lines are areas on top of one another.
    """

    label: str
    lines: Sequence[Line]
    is_stacked: bool = False


@dataclass(frozen=True)
class Span:
    """A part of the time axis that is shaded: begin and end [s], and its text."""

    start: float
    end: float
    text: str = field(default="")


def draw_panels(
    path: Path,
    title: str,
    subtitle: str,
    panels: Sequence[Panel],
    *,
    spans: Sequence[Span] = (),
    time_label: str = "simulation time [s]",
    limits: tuple[float, float] | None = None,
) -> Path:
    """Draw panels below one another as PNG; return the path.

    Args:
        path: the file.
        title, subtitle: heading.
        panels: at least one.
        spans: shaded parts of the time axis, every second one darker.
        time_label: label of the time axis.
        limits: begin and end of the time axis [s]; by default those of the lines.
    """
    count = len(panels)
    height = _BELOW + count * _PANEL + (count - 1) * _GAP + _ABOVE
    figure = new_figure(_WIDTH, height)
    add_title(figure, title, subtitle, _LEFT)
    first, last = limits or _time_limits(panels)
    for number, panel in enumerate(panels):
        bottom = _BELOW + (count - 1 - number) * (_PANEL + _GAP)
        axes = add_axes(figure, _LEFT, bottom, _WIDTH - _LEFT - _RIGHT, _PANEL)
        _shade(axes, spans, has_text=number == 0)
        _draw_panel(axes, panel)
        axes.set_xlim(first, last)
        if number < count - 1:
            axes.set_xticklabels([])
        else:
            axes.set_xlabel(time_label, size=LABEL, color=INK)
    return save(figure, path)


def draw_histogram(
    path: Path, title: str, subtitle: str, label: str, values: Sequence[float]
) -> Path:
    """Draw the distribution of values as PNG; return the path."""
    figure = new_figure(_WIDTH, 3.3)
    add_title(figure, title, subtitle, _LEFT)
    axes = add_axes(figure, _LEFT, _BELOW, _WIDTH - _LEFT - _RIGHT, 1.75)
    upper = max(float(np.percentile(values, 99.5)), 1e-9)
    axes.hist(np.clip(values, 0.0, upper), bins=60, color=COLOURS[0])
    for share, style in ((50, "-"), (95, "--")):
        value = float(np.percentile(values, share))
        axes.axvline(value, color=COLOURS[1], linewidth=1.2, linestyle=style)
        axes.text(value, axes.get_ylim()[1], f" p{share}", size=SMALL, color=INK, va="top")
    axes.set_xlabel(label, size=LABEL, color=INK)
    axes.set_ylabel("number", size=LABEL, color=INK)
    return save(figure, path)


def draw_path(
    path: Path, title: str, subtitle: str, x: NDArray[np.float64], y: NDArray[np.float64]
) -> Path:
    """Draw the way of a machine from above as PNG; return the path.

    Args:
        path: the file.
        title, subtitle: heading.
        x, y: positions of the base [m], shape (n,).
    """
    size = 4.6
    figure = new_figure(_LEFT + size + 0.6, _BELOW + size + _ABOVE)
    add_title(figure, title, subtitle, _LEFT)
    axes = add_axes(figure, _LEFT, _BELOW, size, size)
    axes.plot(x, y, color=COLOURS[0], linewidth=1.2)
    axes.plot(x[:1], y[:1], "o", color=COLOURS[2], markersize=6, label="begin")
    axes.plot(x[-1:], y[-1:], "s", color=COLOURS[1], markersize=6, label="end")
    middle = 0.5 * (x.min() + x.max()), 0.5 * (y.min() + y.max())
    half = max(0.55 * max(float(np.ptp(x)), float(np.ptp(y))), 1.0)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]", size=LABEL, color=INK)
    axes.set_ylabel("y [m]", size=LABEL, color=INK)
    axes.grid(visible=True, color="#e3e5e8", linewidth=0.5)
    axes.legend(fontsize=SMALL, frameon=False)
    return save(figure, path)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    axes.grid(visible=True, color="#e3e5e8", linewidth=0.5)
    axes.set_axisbelow(True)
    if panel.is_stacked and panel.lines:
        times = panel.lines[0].times
        parts = [np.interp(times, line.times, line.values) for line in panel.lines]
        names = [line.name for line in panel.lines]
        axes.stackplot(times, *parts, labels=names, colors=COLOURS)
    else:
        for number, line in enumerate(panel.lines):
            axes.plot(
                line.times,
                line.values,
                color=GREY if line.is_dashed else COLOURS[number % len(COLOURS)],
                linewidth=0.9,
                linestyle="--" if line.is_dashed else "-",
                label=line.name,
            )
    axes.set_ylabel(panel.label, size=SMALL, color=INK)
    axes.margins(y=0.08)
    if panel.lines and panel.lines[0].name and len(panel.lines) <= _MAX_LEGEND:
        axes.legend(
            fontsize=SMALL - 1, frameon=False, loc="upper left", bbox_to_anchor=(1.005, 1.05)
        )


def _shade(axes: Axes, spans: Sequence[Span], *, has_text: bool) -> None:
    for number, span in enumerate(spans):
        if number % 2 == 0:
            axes.axvspan(span.start, span.end, color=_SPAN_COLOUR, linewidth=0, zorder=0)
        if has_text and span.text and len(spans) <= 40:
            axes.text(
                0.5 * (span.start + span.end),
                1.02,
                span.text,
                size=SMALL - 1,
                color=GREY,
                ha="center",
                va="bottom",
                transform=axes.get_xaxis_transform(),
            )


def _time_limits(panels: Sequence[Panel]) -> tuple[float, float]:
    times = [line.times for panel in panels for line in panel.lines if line.times.size]
    if not times:
        return 0.0, 1.0
    first, last = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    return (first, last) if last > first else (first - 0.5, first + 0.5)

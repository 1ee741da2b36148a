"""Colours, type sizes, and figures laid out in inches.

The colours of phases are those of Okabe and Ito, distinguishable with all common kinds of colour
vision (https://jfly.uni-koeln.de/color/). matplotlib's global state is not changed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke

__all__ = [
    "BOLD",
    "CHANGE_COLOURS",
    "CUT",
    "DPI",
    "FILL",
    "GREY",
    "HEIGHT_COLOURS",
    "INK",
    "LABEL",
    "SMALL",
    "add_axes",
    "add_colour_bar",
    "add_title",
    "halo",
    "label_chart",
    "label_metres",
    "new_figure",
    "nice_length",
    "nice_step",
    "phase_colours",
    "save",
    "scale",
]

DPI = 150
INK = "#22252a"
GREY = "#6b7078"
CUT, FILL = "#a3262e", "#1f5c99"  # ends of CHANGE_COLOURS, for text

SMALL, LABEL, BOLD, HEADING = 8.0, 9.5, 10.5, 15.0  # type sizes [pt]

# Lightness rises with height and falls with the magnitude of change: both work in grey, too.
HEIGHT_COLOURS = LinearSegmentedColormap.from_list(
    "height", ["#5f7480", "#8d9a93", "#b9b59a", "#dccfae", "#f6efdc"]
)
CHANGE_COLOURS = LinearSegmentedColormap.from_list(
    "change",
    ["#7f1420", "#c4473d", "#eda183", "#f3efe8", "#93bfdd", "#3f83bd", "#12406f"],
)

PHASE_COLOURS = {
    "dig": "#d55e00",
    "lift": "#e69f00",
    "swing": "#0072b2",
    "dump": "#009e73",
    "reach": "#cc79a7",
    "curl": "#f0e442",
}
OTHER_COLOURS = ("#56b4e9", "#000000", "#8c8c8c", "#d3d3d3")


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size [in] on an Agg canvas."""
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def add_axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Add axes at a position and of a size in the figure [in]."""
    full_width, full_height = figure.get_size_inches()
    axes = figure.add_axes(
        (left / full_width, bottom / full_height, width / full_width, height / full_height)
    )
    for spine in axes.spines.values():
        spine.set_color(GREY)
        spine.set_linewidth(0.6)
    axes.tick_params(labelsize=SMALL, color=GREY, labelcolor=INK, width=0.6, length=3)
    return axes


def add_title(figure: Figure, title: str, subtitle: str, left: float) -> None:
    """Add a heading and a subtitle that start at `left` [in]."""
    width, height = figure.get_size_inches()
    figure.text(
        left / width,
        1 - 0.24 / height,
        title,
        size=HEADING,
        weight="bold",
        color=INK,
        va="top",
    )
    figure.text(left / width, 1 - 0.58 / height, subtitle, size=LABEL, color=GREY, va="top")


def add_colour_bar(axes: Axes, colours: ScalarMappable, label: str) -> None:
    """Fill axes, wider than high, with a colour bar."""
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    bar = figure.colorbar(colours, cax=axes, orientation="horizontal")
    bar.set_label(label, size=LABEL, color=INK)
    bar.ax.tick_params(labelsize=SMALL, color=GREY, labelcolor=INK, width=0.6, length=3)
    bar.outline.set_visible(False)


def label_metres(axes: Axes, x: str, y: str) -> None:
    """Label both axes with their quantity and the unit."""
    axes.set_xlabel(f"{x} [m]", size=LABEL, color=INK)
    axes.set_ylabel(f"{y} [m]", size=LABEL, color=INK)


def label_chart(axes: Axes, title: str, x: str, y: str) -> None:
    """Add a title at the left, axis labels, and a legend of what was drawn."""
    axes.set_title(title, size=LABEL, color=INK, loc="left")
    axes.set_xlabel(x, size=LABEL, color=INK)
    axes.set_ylabel(y, size=LABEL, color=INK)
    axes.legend(fontsize=SMALL, frameon=False)


def halo(width: float = 2.5, colour: str = "white") -> list[AbstractPathEffect]:
    """Return an outline that keeps text and lines readable on any background."""
    return [withStroke(linewidth=width, foreground=colour)]


def nice_step(span: float, max_steps: int) -> float:
    """Return the smallest of 1, 2, 5 x 10^k that gives at most `max_steps` steps in a span."""
    if not span > 0.0:
        return 1.0
    rough = span / max_steps
    decade = 10.0 ** np.floor(np.log10(rough))
    return float(
        next(f * decade for f in (1.0, 2.0, 5.0, 10.0) if f * decade >= rough * (1 - 1e-9))
    )


def nice_length(max_length: float) -> float:
    """Return the largest of 1, 2, 5 x 10^k that is at most `max_length`."""
    decade = 10.0 ** np.floor(np.log10(max_length))
    return float(max(f * decade for f in (1.0, 2.0, 5.0) if f * decade <= max_length))


def phase_colours(phases: list[str]) -> dict[str, str]:
    """Return a colour for each phase: its fixed colour, or one of the others in turn."""
    others = [phase for phase in phases if phase not in PHASE_COLOURS]
    extra = {phase: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, phase in enumerate(others)}
    return {phase: PHASE_COLOURS.get(phase) or extra[phase] for phase in phases}


def scale(low: float, high: float) -> Normalize:
    """Return the limits of a colour scale, at least 0.1 apart."""
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 0.05)
    return Normalize(middle - half, middle + half)


def save(figure: Figure, path: Path) -> Path:
    """Write the figure as PNG, create its folder if needed, and return the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI, format="png")
    return path

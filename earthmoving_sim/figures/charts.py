"""Charts of measured speeds beside those of the reference, with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from earthmoving_sim.pictures.style import (
    FILL,
    GREY,
    INK,
    LABEL,
    SMALL,
    add_axes,
    add_title,
    new_figure,
    save,
)

__all__ = ["draw_bars", "draw_particle_speed"]

_WIDTH, _HEIGHT = 8.0, 4.2
_REAL_TIME = 1.0
_REFERENCE_COLOUR = "#b98b4a"


def draw_bars(
    path: Path,
    *,
    title: str,
    subtitle: str,
    labels: Sequence[str],
    here: Sequence[float],
    reference: Sequence[float],
    axis: str,
) -> None:
    """Draw real-time factors here and frame rates of the reference as bars side by side.

    Args:
        path: the file to write.
        title, subtitle: heading.
        labels: label of each pair of charts.
        here: real-time factors.
        reference: frames per second of the reference.
        axis: what the labels are.
    """
    figure = new_figure(_WIDTH, _HEIGHT)
    add_title(figure, title, subtitle, 0.6)
    left = add_axes(figure, 0.7, 0.65, 3.0, 2.6)
    right = add_axes(figure, 4.6, 0.65, 3.0, 2.6)
    for axes, values, colour, form in (
        (left, here, FILL, "{:.1f}"),
        (right, reference, _REFERENCE_COLOUR, "{:.0f}"),
    ):
        bars = axes.bar(labels, values, width=0.62, color=colour)
        axes.bar_label(bars, [form.format(value) for value in values], size=SMALL, color=INK)
        axes.set_xlabel(axis, size=LABEL, color=INK)
        axes.set_ylim(0.0, 1.18 * max(values))
    left.axhline(_REAL_TIME, color=GREY, linewidth=0.8, linestyle="--")
    left.set_ylabel("real-time factor", size=LABEL, color=INK)
    right.set_ylabel("frames per second", size=LABEL, color=INK)
    left.set_title("here", size=LABEL, color=INK)
    right.set_title("reference of 2014", size=LABEL, color=INK)
    save(figure, path)


def draw_particle_speed(
    path: Path,
    *,
    counts: Sequence[float],
    factors: Sequence[float],
    reference: Sequence[tuple[int, float]],
) -> None:
    """Draw speed over the number of particles, here and in the reference.

    Args:
        path: the file to write.
        counts, factors: maximum number of particles and real-time factor of each run here.
        reference: particles and frames per second of the reference.
    """
    figure = new_figure(_WIDTH, _HEIGHT)
    add_title(
        figure,
        "Speed over the number of particles",
        "Here: one dig cycle, simulated over computing time. Reference: frames per second.",
        0.6,
    )
    here = add_axes(figure, 0.7, 0.65, 3.0, 2.6)
    there = add_axes(figure, 4.6, 0.65, 3.0, 2.6)
    here.semilogx(counts, factors, "o-", color=FILL, markersize=4)
    here.axhline(_REAL_TIME, color=GREY, linewidth=0.8, linestyle="--")
    here.set_ylim(0.0, 1.15 * max(factors))
    here.set_ylabel("real-time factor", size=LABEL, color=INK)
    here.set_title("here", size=LABEL, color=INK)
    numbers, rates = np.array(reference).T
    there.plot(numbers, rates, "o-", color=_REFERENCE_COLOUR, markersize=4)
    there.set_ylim(0.0, 1.15 * float(rates.max()))
    there.set_ylabel("frames per second", size=LABEL, color=INK)
    there.set_title("reference of 2014", size=LABEL, color=INK)
    for axes in (here, there):
        _label_particles(axes)
    save(figure, path)


def _label_particles(axes: Axes) -> None:
    axes.set_xlabel("maximum number of particles", size=LABEL, color=INK)
    axes.grid(visible=True, color="#e3e5e8", linewidth=0.5)
    axes.set_axisbelow(True)

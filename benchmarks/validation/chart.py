"""Draw the results of the experiments: runout, outflow, and poured angles."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.validation.column_collapse import CollapseResult, axisymmetric_law, planar_law
from benchmarks.validation.hopper_outflow import EMPTY_ANNULUS, Flow, flow_exponent
from earthmoving_sim.pictures.style import (
    CUT,
    DPI,
    FILL,
    GREY,
    SMALL,
    add_axes,
    label_chart,
    new_figure,
)

__all__ = ["Results", "draw_chart"]


@dataclass
class Results:
    """Results for the chart.

    Attributes:
        collapses: runouts by the shape of the column, "axisymmetric" or "planar".
        flows: outflows through each opening.
        angles: angle of repose of the soil and measured angle [deg], by soil.
    """

    collapses: dict[str, list[CollapseResult]] = field(default_factory=dict)
    flows: list[Flow] = field(default_factory=list)
    angles: dict[str, tuple[float, float]] = field(default_factory=dict)


def draw_chart(path: Path, results: Results) -> None:
    """Write a figure of the results beside the laws and parameters."""
    figure = new_figure(12.6, 4.3)
    runout, flow, angle = (add_axes(figure, 0.6 + 4.15 * k, 0.6, 3.5, 3.3) for k in range(3))
    _draw_runout(runout, results.collapses)
    _draw_flow(flow, results.flows)
    _draw_angle(angle, results.angles)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)


def _draw_runout(axes: Axes, collapses: dict[str, list[CollapseResult]]) -> None:
    """Draw the runout against the aspect ratio."""
    aspects = np.linspace(0.3, 3.5, 200)
    laws = {"axisymmetric": axisymmetric_law, "planar": planar_law}
    for (name, results), colour in zip(collapses.items(), (CUT, FILL), strict=True):
        expected = [laws[name](aspect) for aspect in aspects.tolist()]
        axes.plot(aspects, expected, color=colour, linewidth=1.0, label=f"{name}, Lube et al.")
        axes.plot([each.aspect for each in results], [each.runout for each in results], "o",
                  color=colour, markersize=5, label=f"{name}, simulated")  # fmt: skip
    label_chart(
        axes, "Runout of a column", "height / radius or length", "runout / radius or length"
    )


def _draw_flow(axes: Axes, flows: list[Flow]) -> None:
    """Draw the outflow against the effective hole diameter, both logarithmic."""
    openings = np.array([flow.opening for flow in flows])
    diameters = np.linspace(0.9 * openings.min(), 1.1 * openings.max(), 100)
    scale = flows[-1].expected_rate / (openings[-1] - EMPTY_ANNULUS) ** 2.5
    expected = scale * (diameters - EMPTY_ANNULUS) ** 2.5
    axes.loglog(
        diameters - EMPTY_ANNULUS, expected, color=GREY, linewidth=1.0, label="Beverloo et al."
    )
    axes.loglog(openings - EMPTY_ANNULUS, [flow.rate for flow in flows], "o", color=CUT,
                markersize=5, label=f"simulated, exponent {flow_exponent(flows):.2f}")  # fmt: skip
    labels = [f"{opening:g} - {EMPTY_ANNULUS:g}" for opening in openings]
    axes.set_xticks(openings - EMPTY_ANNULUS, labels)
    axes.minorticks_off()
    label_chart(axes, "Outflow of a bin", "hole - 1.4, in particle diameters", "particles/s")


def _draw_angle(axes: Axes, angles: dict[str, tuple[float, float]]) -> None:
    """Draw the measured angle of heaps against the angle of repose, with a band of 2 deg."""
    expected, measured = np.array(list(angles.values())).T
    ends = np.array([expected.min() - 4.0, expected.max() + 4.0])
    axes.plot(ends, ends, color=GREY, linewidth=1.0, label="equal")
    axes.fill_between(ends, ends - 2.0, ends + 2.0, color=GREY, alpha=0.15, linewidth=0.0)
    axes.plot(expected, measured, "o", color=FILL, markersize=5, label="simulated")
    for name, x, y in zip(angles, expected, measured, strict=True):
        axes.annotate(name, (x, y), xytext=(6, -9), textcoords="offset points", size=SMALL)
    label_chart(axes, "Angle of a poured heap", "angle of repose [deg]", "measured angle [deg]")

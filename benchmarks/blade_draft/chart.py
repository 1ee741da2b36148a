"""Draw measured, resolved and simulated forces on blades."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.blade_draft.measured import SANDS, Draft
from benchmarks.blade_draft.resolved import WINDOWS, ResolvedDrag
from earthmoving_sim.pictures.style import (
    CUT,
    DPI,
    FILL,
    GREY,
    add_axes,
    label_chart,
    new_figure,
)

__all__ = ["draw_chart"]

_COLOURS = (CUT, FILL, GREY)


def draw_chart(
    path: Path, drafts: Sequence[Draft], drags: Sequence[tuple[ResolvedDrag, ResolvedDrag]]
) -> None:
    """Write a figure of three panels.

    Args:
        path: of the picture.
        drafts: measured and simulated forces; a panel for each of two widths.
        drags: drags of this project and of LIGGGHTS; the upright blades of the first sand appear.
    """
    figure = new_figure(12.6, 4.3)
    panels = [add_axes(figure, 0.6 + 4.15 * k, 0.6, 3.4, 3.3) for k in range(3)]
    widths = sorted({draft.test.width for draft in drafts})
    for axes, width in zip(panels, widths, strict=False):
        _draw_measured(axes, [draft for draft in drafts if draft.test.width == width])
        title = f"Draft of an upright blade of {width:g} m"
        label_chart(axes, title, "depth [m]", "force [kN]")
    _draw_resolved(panels[-1], drags)
    label_chart(panels[-1], "Upright blades in spheres, 0.2 m deep", "travel [m]", "kN per metre")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)


def _draw_measured(axes: Axes, drafts: Sequence[Draft]) -> None:
    """Draw measured forces with the error of their reading, and both sands as ranges of grids."""
    depths = [draft.test.depth for draft in drafts]
    labels = ("simulated, no cohesion", "simulated, 1 kPa")
    for sand, colour, label in zip(SANDS, (CUT, FILL), labels, strict=True):
        forces = 1e-3 * np.array([draft.forces[sand] for draft in drafts])
        axes.fill_between(
            depths, forces.min(axis=1), forces.max(axis=1), color=colour, alpha=0.3, linewidth=0.0
        )
        axes.plot(depths, forces.mean(axis=1), color=colour, linewidth=1.0, label=label)
    axes.errorbar(
        depths, [1e-3 * draft.test.force for draft in drafts],
        yerr=[1e-3 * draft.test.reading_error for draft in drafts],
        fmt="o", color=GREY, markersize=5, capsize=3, label="measured",
    )  # fmt: skip


def _draw_resolved(axes: Axes, drags: Sequence[tuple[ResolvedDrag, ResolvedDrag]]) -> None:
    """Draw the draft of the upright blades per width over the travel."""
    middles = [0.5 * (low + high) for low, high in WINDOWS]
    upright = [pair for pair in drags if _is_upright(pair[0])]
    for (ours, spheres), colour in zip(upright, _COLOURS, strict=False):
        width = ours.blade.width
        is_wide = not math.isfinite(width)
        name, per_metre = ("wide", 1.0) if is_wide else (f"{width:g} m", width)
        for drag, style, label in ((ours, "-", name), (spheres, "o", f"{name}, LIGGGHTS")):
            draft = [1e-3 * force[0] / per_metre for force in drag.forces]
            axes.plot(middles, draft, style, color=colour, markersize=5, linewidth=1.0, label=label)
    axes.set_ylim(bottom=0.0)


def _is_upright(drag: ResolvedDrag) -> bool:
    return drag.blade.rake == 90.0 and drag.blade.soil == "spheres"

"""Maps of the ground before and after a run, and of the difference with its volumes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from earthmoving_sim.pictures.map_window import Window, window_around
from earthmoving_sim.pictures.plan_view import (
    contour_levels,
    draw_contours,
    draw_key_map,
    draw_machine,
    draw_scale_bar,
    height_scale,
    hillshade,
    surface_image,
)
from earthmoving_sim.pictures.site_record import MIN_CHANGE_M, SiteRecord
from earthmoving_sim.pictures.style import (
    BOLD,
    CHANGE_COLOURS,
    CUT,
    FILL,
    INK,
    add_axes,
    add_colour_bar,
    add_title,
    halo,
    label_metres,
    new_figure,
    save,
)

__all__ = ["draw_cut_fill", "volume_lines"]

PANEL, GAP, LEFT, RIGHT, BELOW, ABOVE = 4.4, 0.42, 0.72, 0.25, 1.32, 1.42  # [in]
SHADE = 0.3  # strength of the hillshade of the change, weak so that its colours can be read


def draw_cut_fill(record: SiteRecord, path: Path) -> Path:
    """Write three maps of the worked ground as PNG: before, after and difference.

    The volumes in the third are those of the whole map. Returns the path of the picture.
    """
    window = window_around(record.grid, _changed_or_path_points(record))
    panel_height = PANEL * window.size[1] / window.size[0]
    figure = new_figure(LEFT + 3 * PANEL + 2 * GAP + RIGHT, BELOW + panel_height + ABOVE)
    lefts = [LEFT + i * (PANEL + GAP) for i in range(3)]
    before, after, change = (add_axes(figure, left, BELOW, PANEL, panel_height) for left in lefts)

    limits = height_scale(window, record.before, record.after)
    levels = contour_levels(limits, max_steps=12)
    heights = surface_image(before, window, record.before, limits, levels=levels)
    surface_image(after, window, record.after, limits, levels=levels)
    draw_machine(after, record)
    colours = change_image(change, window, record)
    draw_volumes(change, record)

    for axes, name in ((before, "Before"), (after, "After"), (change, "Cut and fill")):
        axes.set_title(name, loc="left", size=BOLD, weight="bold", color=INK)
        label_metres(axes, "x", "y")
    draw_scale_bar(change, window)
    after.set_ylabel("")
    change.set_ylabel("")
    across = 2 * PANEL + GAP
    bar = add_axes(figure, LEFT + 0.2 * across, 0.52, 0.6 * across, 0.13)
    add_colour_bar(bar, heights, "height z [m]")
    bar = add_axes(figure, lefts[2] + 0.1 * PANEL, 0.52, 0.8 * PANEL, 0.13)
    add_colour_bar(bar, colours, "change of height [m]   (cut < 0 < fill)")

    size = 1.12
    shape = record.grid.size[0] / record.grid.size[1]
    width = size * min(shape, 1.6)
    key = add_axes(
        figure, lefts[2] + PANEL - width, BELOW + panel_height + 0.2, width, width / shape
    )
    draw_key_map(key, record, window)
    step = f"{levels[1] - levels[0]:.3g}" if len(levels) > 1 else "1"
    subtitle = (
        f"{record.grid.cell:g} m columns · contours every {step} m · x and y in the map frame"
    )
    add_title(figure, record.title, subtitle, LEFT)
    return save(figure, path)


def _changed_or_path_points(record: SiteRecord) -> NDArray[np.float64]:
    """Return the points to show (n, 2) [m]: changed columns, or else the lip's path."""
    changed = record.changed_points
    return changed if len(changed) else record.lip_path[:, :2]


def change_image(axes: Axes, window: Window, record: SiteRecord) -> ScalarMappable:
    """Draw after - before in colours centred at 0, with hillshade; return the colour scale."""
    change = window.crop(record.change)
    max_change = max(float(np.abs(change).max()), 0.05)
    limits = Normalize(-max_change, max_change)
    tint = CHANGE_COLOURS(limits(change))[..., :3]
    axes.imshow(
        hillshade(tint, window.crop(record.after), record.grid.cell, SHADE),
        extent=window.extent,
        origin="lower",
        interpolation="bilinear",
    )
    levels = contour_levels(limits, max_steps=12)
    draw_contours(axes, window, change, levels[np.abs(levels) > 1e-9], form="{:+.{}f}")
    # Unchanged ground is exactly 0, where a contour is not defined: the zero line is drawn at the
    # smallest change that counts, on either side.
    zero = [side for side in (-MIN_CHANGE_M, MIN_CHANGE_M) if change.min() < side < change.max()]
    if zero:
        axes.contour(
            window.x, window.y, change, levels=zero, colors=INK, linewidths=1.0, linestyles="solid"
        )
    axes.set_aspect("equal")
    return ScalarMappable(limits, CHANGE_COLOURS)


def volume_lines(record: SiteRecord) -> tuple[str, str]:
    """Return cut and fill of the whole map as text."""
    return f"cut {record.cut_volume:.2f} m³", f"fill {record.fill_volume:.2f} m³"


def draw_volumes(axes: Axes, record: SiteRecord) -> None:
    """Print cut and fill in the upper right of the map of change."""
    for i, (line, colour) in enumerate(zip(volume_lines(record), (CUT, FILL), strict=True)):
        axes.text(
            0.965,
            0.965 - 0.062 * i,
            line,
            size=BOLD + 1,
            weight="bold",
            color=colour,
            ha="right",
            va="top",
            transform=axes.transAxes,
            path_effects=halo(3.0),
            zorder=9,
        )

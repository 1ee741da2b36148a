"""Before, after and what changed: the site's earthworks balance seen from above."""

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
SHADE = 0.3  # hillshade of the change, weaker than the ground's: its colours are the message


def draw_cut_fill(record: SiteRecord, path: Path) -> Path:
    """Write three maps of the worked ground, before, after and their difference, as PNG.

    Returns the path. The volumes in the third are summed over the whole map.
    """
    window = window_around(record.grid, _changed_or_path_points(record))
    tall = PANEL * window.size[1] / window.size[0]
    figure = new_figure(LEFT + 3 * PANEL + 2 * GAP + RIGHT, BELOW + tall + ABOVE)
    lefts = [LEFT + i * (PANEL + GAP) for i in range(3)]
    before, after, change = (add_axes(figure, left, BELOW, PANEL, tall) for left in lefts)

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
    wide = size * min(shape, 1.6)
    key = add_axes(figure, lefts[2] + PANEL - wide, BELOW + tall + 0.2, wide, wide / shape)
    draw_key_map(key, record, window)
    step = f"{levels[1] - levels[0]:.3g}" if len(levels) > 1 else "1"
    about = f"{record.grid.cell:g} m columns · contours every {step} m · x and y in the map frame"
    add_title(figure, record.title, about, LEFT)
    return save(figure, path)


def _changed_or_path_points(record: SiteRecord) -> NDArray[np.float64]:
    """Points the picture must hold: worked ground, else the bucket's path, else nothing."""
    worked = record.changed_points
    return worked if len(worked) else record.lip_path[:, :2]


def change_image(axes: Axes, window: Window, record: SiteRecord) -> ScalarMappable:
    """Draw after - before with colours centred at 0, on the shaded ground; return the colours."""
    change = window.crop(record.change)
    most = max(float(np.abs(change).max()), 0.05)
    limits = Normalize(-most, most)
    tint = CHANGE_COLOURS(limits(change))[..., :3]
    axes.imshow(
        hillshade(tint, window.crop(record.after), record.grid.cell, SHADE),
        extent=window.extent,
        origin="lower",
        interpolation="bilinear",
    )
    levels = contour_levels(limits, max_steps=12)
    draw_contours(axes, window, change, levels[np.abs(levels) > 1e-9], form="{:+.{}f}")
    # Untouched ground is exactly 0, so a contour there would wander: the zero line is drawn where
    # the change becomes worth the name, on either side.
    zero = [side for side in (-MIN_CHANGE_M, MIN_CHANGE_M) if change.min() < side < change.max()]
    if zero:
        axes.contour(
            window.x, window.y, change, levels=zero, colors=INK, linewidths=1.0, linestyles="solid"
        )
    axes.set_aspect("equal")
    return ScalarMappable(limits, CHANGE_COLOURS)


def volume_lines(record: SiteRecord) -> tuple[str, str]:
    """The totals as they are printed: cut and fill of the whole map [m^3]."""
    return f"cut {record.cut_volume:.2f} m³", f"fill {record.fill_volume:.2f} m³"


def draw_volumes(axes: Axes, record: SiteRecord) -> None:
    """Print the totals in the upper right of the map of change."""
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

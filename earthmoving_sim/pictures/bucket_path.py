"""Where the bucket's lip went: from above by phase, from the side while it dug, and over time."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from earthmoving_sim.pictures.map_window import window_around
from earthmoving_sim.pictures.plan_view import (
    contour_levels,
    draw_machine,
    draw_scale_bar,
    height_scale,
    surface_image,
)
from earthmoving_sim.pictures.site_record import SiteRecord
from earthmoving_sim.pictures.style import (
    BOLD,
    GREY,
    INK,
    SMALL,
    add_axes,
    add_colour_bar,
    add_title,
    halo,
    label_metres,
    new_figure,
    phase_colours,
    save,
)
from msg_bridge.contract.grid import Grid

__all__ = ["dig_azimuth", "draw_bucket_path", "heights_at"]

LEFT, PLAN, GAP, SIDE, RIGHT, BELOW, ABOVE = 0.72, 6.0, 0.85, 7.0, 0.25, 1.32, 1.1  # [in]
FOOT, BETWEEN, BAR = 0.62, 0.95, 0.12  # below and between the right-hand panels, colour bar [in]

PROFILE_MARGIN_M = 1.2  # ground shown in the side view beyond what was dug [m]
MAX_LABELLED_CYCLES = 6  # with more cycles than this, only the first and the last are in the legend

# Dark to light, all of it dark enough to be seen on the pale ground.
CYCLE_COLOURS = LinearSegmentedColormap.from_list(
    "cycle", ["#1b1033", "#5a1d6b", "#a8325e", "#de5d2f", "#f0a202"]
)


def draw_bucket_path(record: SiteRecord, path: Path) -> Path:
    """Write a plan view of the lip's path, a side view of its digging, and its height as PNG.

    Returns the path.
    """
    seen = [record.changed_points, record.lip_path[:, :2], record.outline_points]
    window = window_around(record.grid, np.concatenate(seen))
    tall = PLAN * window.size[1] / window.size[0]
    tall = max(tall, 5.2)
    figure = new_figure(LEFT + PLAN + GAP + SIDE + RIGHT, BELOW + tall + ABOVE)
    plan = add_axes(figure, LEFT, BELOW, PLAN, tall)
    right = LEFT + PLAN + GAP
    low = 0.4 * (tall + BELOW - FOOT - BETWEEN)
    top = FOOT + low + BETWEEN
    side = add_axes(figure, right, top, SIDE, BELOW + tall - top)
    over = add_axes(figure, right, FOOT, SIDE, low)

    limits = height_scale(window, record.after)
    heights = surface_image(
        plan,
        window,
        record.after,
        limits,
        levels=contour_levels(limits, max_steps=8),
        labelled=False,
    )
    draw_machine(plan, record)
    draw_plan(plan, record)
    draw_scale_bar(plan, window)
    draw_side(side, record)
    draw_heights(over, record)
    titles = (
        (plan, "Path of the lip over the ground as it ended"),
        (side, "Digging, from the side; the ground is along the dashed line"),
        (over, "Height of the lip along its path"),
    )
    for axes, name in titles:
        axes.set_title(name, loc="left", size=BOLD, weight="bold", color=INK)
    add_colour_bar(
        add_axes(figure, LEFT + 0.2 * PLAN, 0.52, 0.6 * PLAN, BAR), heights, "height z [m]"
    )
    cycles = len(np.unique(record.lip_cycle))
    count = "1 cycle" if cycles == 1 else f"{cycles} cycles"
    about = f"{count} · lip travelled {_travelled(record)[-1]:.0f} m"
    add_title(figure, record.title, about, LEFT)
    return save(figure, path)


def draw_plan(axes: Axes, record: SiteRecord) -> None:
    """The path in its phases' colours, and the line that the side view's ground is taken along."""
    colours = phase_colours(_phases(record))
    lines = _phase_lines(record, record.lip_path[:, :2], colours)
    lines.set_path_effects(halo(2.4))
    axes.add_collection(lines, autolim=False)
    keys: list[Line2D] = [Line2D([], [], color=c, lw=2.2, label=p) for p, c in colours.items()]
    azimuth = dig_azimuth(record)
    if azimuth is not None:
        reach = _dig_reach(record)
        ends = record.machine_origin + np.outer([0.0, reach[1]], [np.cos(azimuth), np.sin(azimuth)])
        profile = {"color": INK, "lw": 1.0, "ls": (0, (6, 3))}
        axes.plot(*ends.T, **profile, zorder=5)  # type: ignore[arg-type]
        axes.plot(*record.machine_origin, "+", color=INK, ms=8, mew=1.2, zorder=6)
        keys.append(Line2D([], [], **profile, label="profile"))  # type: ignore[arg-type]
    if keys:
        legend = axes.legend(
            handles=keys, fontsize=SMALL, loc="upper right", framealpha=0.9, edgecolor="none"
        )
        legend.set_zorder(9)
    label_metres(axes, "x", "y")


def draw_side(axes: Axes, record: SiteRecord) -> None:
    """The lip in each cycle's dig phase, seen square to the dig direction, over the ground."""
    label_metres(axes, "distance from the machine r", "height z")
    azimuth = dig_azimuth(record)
    if azimuth is None:
        axes.text(
            0.5,
            0.5,
            "nothing was dug",
            size=BOLD,
            color=GREY,
            ha="center",
            transform=axes.transAxes,
        )
        return
    dug = record.lip_phase == "dig"
    path = _radial(record)
    direction = np.array([np.cos(azimuth), np.sin(azimuth)])
    r = np.linspace(*_dig_reach(record), 400)
    points = record.machine_origin + np.outer(r, direction)
    shown = [heights_at(record.grid, h, points) for h in (record.before, record.after)]
    _set_equal_limits(axes, r, np.concatenate([*shown, path[dug, 1]]))

    r = np.linspace(*axes.get_xlim(), 400)
    points = record.machine_origin + np.outer(r, direction)
    before, after = (heights_at(record.grid, h, points) for h in (record.before, record.after))
    axes.fill_between(r, after, axes.get_ylim()[0], fc="#d9c9ae", ec="none")
    axes.fill_between(r, before, after, where=list(before > after), fc="#efe6d6", ec="none")
    axes.plot(r, before, color=GREY, lw=1.1, ls=(0, (5, 2)), label="ground before")
    axes.plot(r, after, color=INK, lw=1.5, label="ground after")
    cycles = np.unique(record.lip_cycle[dug])
    colours = CYCLE_COLOURS(np.linspace(0.0, 1.0, max(len(cycles), 2)))
    for cycle, colour in zip(cycles, colours, strict=False):
        of_cycle = np.where((dug & (record.lip_cycle == cycle))[:, None], path, np.nan)
        label = (
            f"cycle {cycle}"
            if len(cycles) <= MAX_LABELLED_CYCLES or cycle in cycles[[0, -1]]
            else None
        )
        axes.plot(*of_cycle.T, color=colour, lw=1.4, label=label)
    axes.legend(fontsize=SMALL, loc="best", framealpha=0.9, edgecolor="none", ncols=2)


def _set_equal_limits(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    """Limits that hold all values with a margin and show both axes at one scale, as the box is."""
    box = np.array([axes.bbox.width, axes.bbox.height])
    low, high = np.array([x.min(), y.min() - 0.3]), np.array([x.max(), y.max() + 0.3])
    half = 0.5 * box * ((high - low) / box).max()
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])


def draw_heights(axes: Axes, record: SiteRecord) -> None:
    """Height of the lip over the distance it has travelled, in its phases' colours."""
    label_metres(axes, "distance travelled by the lip", "height z")
    axes.grid(axis="y", color="#e4e4e4", lw=0.6)
    axes.set_axisbelow(True)
    if not len(record.lip_path):
        return
    travelled, height = _travelled(record), record.lip_path[:, 2]
    lines = np.stack([travelled, height], axis=1)
    axes.add_collection(_phase_lines(record, lines, phase_colours(_phases(record))))
    starts = np.flatnonzero(np.diff(record.lip_cycle, prepend=record.lip_cycle[0] - 1))
    for start in starts[1:]:
        axes.axvline(travelled[start], color=GREY, lw=0.6, ls=":")
    for start in starts[:: max(1, len(starts) // 12)]:
        axes.annotate(
            f"cycle {record.lip_cycle[start]}"
            if start == starts[0]
            else f"{record.lip_cycle[start]}",
            (travelled[start], 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -3),
            textcoords="offset points",
            size=SMALL - 1,
            color=GREY,
            va="top",
        )
    axes.set_xlim(0.0, max(float(travelled[-1]), 1.0))
    axes.set_ylim(height.min() - 0.3, height.max() + 0.7)


def dig_azimuth(record: SiteRecord) -> float | None:
    """Mean direction from the machine to where it dug, from +x toward +y [rad]; None if nowhere."""
    offset = record.lip_path[record.lip_phase == "dig", :2] - record.machine_origin
    if not len(offset):
        return None
    mean = (offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-9)).mean(axis=0)
    return float(np.arctan2(mean[1], mean[0]))


def heights_at(
    grid: Grid, heights: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Bilinear height [m] at points x, y [m], shape [n, 2]; beyond the map that of its border."""
    row = np.clip(grid.row(points[:, 0]), 0.0, grid.rows - 1.0)
    col = np.clip(grid.col(points[:, 1]), 0.0, grid.cols - 1.0)
    i = np.minimum(row.astype(int), grid.rows - 2)
    j = np.minimum(col.astype(int), grid.cols - 2)
    u, v = row - i, col - j
    return np.asarray(
        (1 - u) * ((1 - v) * heights[i, j] + v * heights[i, j + 1])
        + u * ((1 - v) * heights[i + 1, j] + v * heights[i + 1, j + 1]),
        dtype=np.float64,
    )


def _phases(record: SiteRecord) -> list[str]:
    """Names of the phases in the order in which they first come."""
    return list(dict.fromkeys(record.lip_phase.tolist()))


def _phase_lines(
    record: SiteRecord, points: NDArray[np.float64], colours: dict[str, str]
) -> LineCollection:
    """A path [n, 2] as one line for each stretch in one phase, joined to the next."""
    phase = record.lip_phase
    starts = np.flatnonzero(phase[1:] != phase[:-1]) + 1
    bounds = [0, *starts.tolist(), len(points)] if len(points) else [0]
    stretches = sorted(pairwise(bounds), key=lambda ends: phase[ends[0]] == "dig")  # on top
    return LineCollection(
        [points[first : last + 1] for first, last in stretches],
        colors=[colours[str(phase[first])] for first, _ in stretches],
        linewidths=[1.7 if phase[first] == "dig" else 1.1 for first, _ in stretches],
        capstyle="round",
        zorder=5,
    )


def _radial(record: SiteRecord) -> NDArray[np.float64]:
    """Horizontal distance from the machine and height of the lip [m], shape [n, 2]."""
    r = np.linalg.norm(record.lip_path[:, :2] - record.machine_origin, axis=1)
    return np.stack([r, record.lip_path[:, 2]], axis=1)


def _dig_reach(record: SiteRecord) -> tuple[float, float]:
    """The least and greatest distance from the machine that the side view shows [m]."""
    r = _radial(record)[record.lip_phase == "dig", 0]
    return max(0.0, float(r.min()) - PROFILE_MARGIN_M), float(r.max()) + PROFILE_MARGIN_M


def _travelled(record: SiteRecord) -> NDArray[np.float64]:
    """Length of the lip's path up to each point [m], shape [n], or [0.] if there is none."""
    steps = np.linalg.norm(np.diff(record.lip_path, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])

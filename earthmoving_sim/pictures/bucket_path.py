"""Path of the bucket's lip: from above by phase, from the side while digging, and its height."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

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

__all__ = ["DigSection", "dig_section", "draw_bucket_path", "heights_at"]

LEFT, PLAN, GAP, SIDE, RIGHT, BELOW, ABOVE = 0.72, 6.0, 0.85, 7.0, 0.25, 1.32, 1.1  # [in]
FOOT, BETWEEN, BAR = 0.62, 0.95, 0.12  # below and between right-hand panels, colour bar [in]

MIN_PLAN_HEIGHT = 5.2  # [in]
PROFILE_MARGIN_M = 1.2  # ground shown in the side view beyond the dig [m]
# Half the width of a bucket of 1 m: the section passes through all that these cycles cut.
NEAR_SECTION_M = 0.5
MAX_LABELLED_CYCLES = 6  # beyond, only the first and last are in the legend

# Dark to light; no colour is as dark as the line of the ground, or as pale as its area.
CYCLE_COLOURS = LinearSegmentedColormap.from_list(
    "cycle", ["#5a1d6b", "#a8325e", "#de5d2f", "#f0a202"]
)


@dataclass(frozen=True, eq=False)
class DigSection:
    """The vertical plane in which the last cycle dug, and the cycles that dug near it.

    Attributes:
        origin: x, y from which distances are measured, that of the machine [m], shape (2,).
        azimuth: direction from there to the lip in the last cycle that dug [rad].
        cycles: cycles that dug within `NEAR_SECTION_M` of the plane, in front of the machine.
    """

    origin: NDArray[np.float64]
    azimuth: float
    cycles: list[int]

    @property
    def direction(self) -> NDArray[np.float64]:
        """Horizontal unit vector along the section, shape (2,)."""
        return np.array([np.cos(self.azimuth), np.sin(self.azimuth)])

    def points(self, r: NDArray[np.float64] | tuple[float, float]) -> NDArray[np.float64]:
        """Return x, y at distances from the machine [m], shape (n, 2)."""
        return self.origin + np.outer(r, self.direction)

    def along(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance from the machine along the section of x, y [m], shape (n,)."""
        return np.asarray((points - self.origin) @ self.direction, dtype=np.float64)

    def beside(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance to the left of the section of x, y [m], shape (n,)."""
        left = np.array([-self.direction[1], self.direction[0]])
        return np.asarray((points - self.origin) @ left, dtype=np.float64)

    def shows(self, record: SiteRecord) -> NDArray[np.bool_]:
        """Return which points of the lip's path are digging in its cycles, shape (n,)."""
        return np.asarray((record.lip_phase == "dig") & np.isin(record.lip_cycle, self.cycles))

    def reach(self, record: SiteRecord) -> tuple[float, float]:
        """Return the minimum and maximum distance from the machine in the side view [m]."""
        r = self.along(record.lip_path[self.shows(record), :2])
        return max(0.0, float(r.min()) - PROFILE_MARGIN_M), float(r.max()) + PROFILE_MARGIN_M


def draw_bucket_path(record: SiteRecord, path: Path) -> Path:
    """Write a plan view of the lip's path, a side view of the digging, and its height as PNG.

    Returns the path of the picture.
    """
    shown_points = [record.changed_points, record.lip_path[:, :2], record.outline_points]
    window = window_around(record.grid, np.concatenate(shown_points))
    plan_height = max(PLAN * window.size[1] / window.size[0], MIN_PLAN_HEIGHT)
    figure = new_figure(LEFT + PLAN + GAP + SIDE + RIGHT, BELOW + plan_height + ABOVE)
    plan = add_axes(figure, LEFT, BELOW, PLAN, plan_height)
    right = LEFT + PLAN + GAP
    profile_height = 0.4 * (plan_height + BELOW - FOOT - BETWEEN)
    side_bottom = FOOT + profile_height + BETWEEN
    side = add_axes(figure, right, side_bottom, SIDE, BELOW + plan_height - side_bottom)
    profile = add_axes(figure, right, FOOT, SIDE, profile_height)

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
    section = dig_section(record)
    draw_plan(plan, record, section)
    draw_scale_bar(plan, window)
    draw_side(side, record, section)
    draw_heights(profile, record)
    titles = (
        (plan, "Path of the lip over the final ground"),
        (side, "Digging along the dashed line, from the side"),
        (profile, "Height of the lip along its path"),
    )
    for axes, name in titles:
        axes.set_title(name, loc="left", size=BOLD, weight="bold", color=INK)
    add_colour_bar(
        add_axes(figure, LEFT + 0.2 * PLAN, 0.52, 0.6 * PLAN, BAR), heights, "height z [m]"
    )
    count = "1 cycle" if record.num_cycles == 1 else f"{record.num_cycles} cycles"
    subtitle = f"{count} · lip travelled {_travelled(record)[-1]:.0f} m"
    add_title(figure, record.title, subtitle, LEFT)
    return save(figure, path)


def draw_plan(axes: Axes, record: SiteRecord, section: DigSection | None) -> None:
    """Draw the path in the colours of its phases, and the line of the side view's section."""
    colours = phase_colours(_phases(record))
    lines = _phase_lines(record, record.lip_path[:, :2], colours)
    lines.set_path_effects(halo(2.4))
    axes.add_collection(lines, autolim=False)
    keys: list[Line2D] = [Line2D([], [], color=c, lw=2.2, label=p) for p, c in colours.items()]
    if section is not None:
        ends = section.points((0.0, section.reach(record)[1]))
        profile = {"color": INK, "lw": 1.0, "ls": (0, (6, 3))}
        axes.plot(*ends.T, **profile, zorder=5)  # type: ignore[arg-type]
        axes.plot(*section.origin, "+", color=INK, ms=8, mew=1.2, zorder=6)
        keys.append(Line2D([], [], **profile, label="section"))  # type: ignore[arg-type]
    if keys:
        legend = axes.legend(
            handles=keys, fontsize=SMALL, loc="upper right", framealpha=0.9, edgecolor="none"
        )
        legend.set_zorder(9)
    label_metres(axes, "x", "y")


def draw_side(axes: Axes, record: SiteRecord, section: DigSection | None) -> None:
    """Draw the ground along the section, and the lip in the cycles that dug near it."""
    label_metres(axes, "distance from the machine r", "height z")
    if section is None:
        middle = axes.transAxes
        axes.text(0.5, 0.5, "nothing was dug", size=BOLD, color=GREY, ha="center", transform=middle)
        return
    shown = section.shows(record)
    path = np.column_stack([section.along(record.lip_path[:, :2]), record.lip_path[:, 2]])
    r = np.linspace(*section.reach(record), 400)
    points = section.points(r)
    profiles = [heights_at(record.grid, h, points) for h in (record.before, record.after)]
    _set_equal_limits(axes, r, np.concatenate([*profiles, path[shown, 1]]))

    _draw_ground(axes, record, section)
    cycles = section.cycles
    colours = CYCLE_COLOURS(np.linspace(0.0, 1.0, max(len(cycles), 2)))
    for cycle, colour in zip(cycles, colours, strict=False):
        cycle_path = np.where((shown & (record.lip_cycle == cycle))[:, None], path, np.nan)
        is_labelled = len(cycles) <= MAX_LABELLED_CYCLES or cycle in (cycles[0], cycles[-1])
        label = _cycle_name(record, cycle) if is_labelled else None
        axes.plot(*cycle_path.T, color=colour, lw=1.4, label=label)
    axes.legend(fontsize=SMALL, loc="best", framealpha=0.9, edgecolor="none", ncols=2)
    num_shown = sum(record.is_finished(cycle) for cycle in cycles)
    note = (
        f"{num_shown} of {record.num_cycles} cycles: those that dug within {NEAR_SECTION_M} m of"
        " the line"
    )
    axes.annotate(
        note,
        (0.0, 0.0),
        xycoords="axes fraction",
        xytext=(6, 6),
        textcoords="offset points",
        size=SMALL,
        color=GREY,
    )


def _draw_ground(axes: Axes, record: SiteRecord, section: DigSection) -> None:
    """Draw the ground along the section, before and after, over the width of the axes.

    Loose soil has a colour of its own: it slid or fell into the cut and lies above the paths.
    """
    r = np.linspace(*axes.get_xlim(), 400)
    before, after, loose = (
        heights_at(record.grid, values, section.points(r))
        for values in (record.before, record.after, record.loose_depth)
    )
    axes.fill_between(r, after - loose, axes.get_ylim()[0], fc="#d9c9ae", ec="none")
    axes.fill_between(r, after, after - loose, fc="#c3a878", ec="none", label="loose soil after")
    axes.fill_between(r, before, after, where=list(before > after), fc="#efe6d6", ec="none")
    axes.plot(r, before, color=GREY, lw=1.1, ls=(0, (5, 2)), label="ground before")
    axes.plot(r, after, color=INK, lw=1.5, label="ground after")


def _set_equal_limits(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    """Set limits that contain all values with a margin and give both axes the same scale."""
    box = np.array([axes.bbox.width, axes.bbox.height])
    low, high = np.array([x.min(), y.min() - 0.3]), np.array([x.max(), y.max() + 0.3])
    half = 0.5 * box * ((high - low) / box).max()
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])


def draw_heights(axes: Axes, record: SiteRecord) -> None:
    """Draw the height of the lip over the distance travelled, in the colours of its phases."""
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
        cycle = int(record.lip_cycle[start])
        if record.is_finished(cycle):
            name = f"cycle {cycle}" if start == starts[0] else f"{cycle}"
            _annotate_top(axes, float(travelled[start]), name, "left")
    if not record.is_finished(int(record.lip_cycle[-1])):
        _annotate_top(axes, float(travelled[-1]), "unfinished", "right")
    axes.set_xlim(0.0, max(float(travelled[-1]), 1.0))
    axes.set_ylim(height.min() - 0.3, height.max() + 0.7)


def _annotate_top(axes: Axes, x: float, text: str, side: Literal["left", "right"]) -> None:
    """Write small text at the top of axes, with its left or right end beside x."""
    axes.annotate(
        text,
        (x, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(3 if side == "left" else -3, -3),
        textcoords="offset points",
        size=SMALL - 1,
        color=GREY,
        va="top",
        ha=side,
    )


def dig_section(record: SiteRecord) -> DigSection | None:
    """Return the section through the last cycle that dug; None without dig.

    Nothing that a later cycle dug or spilled there hides what this cycle cut.
    """
    is_digging = record.lip_phase == "dig"
    dug = np.unique(record.lip_cycle[is_digging]).tolist()
    if not dug:
        return None
    paths = [record.lip_path[is_digging & (record.lip_cycle == cycle), :2] for cycle in dug]
    offset = paths[-1] - record.machine_origin
    unit = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-9)
    x, y = unit.mean(axis=0).tolist()
    section = DigSection(record.machine_origin, math.atan2(y, x), dug[-1:])
    near = [
        cycle for cycle, path in zip(dug[:-1], paths[:-1], strict=True) if _is_near(section, path)
    ]
    return replace(section, cycles=[*near, dug[-1]])


def _is_near(section: DigSection, path: NDArray[np.float64]) -> bool:
    """Return whether points x, y [m] are close to the section and in front of the machine."""
    is_close = np.abs(section.beside(path)).max() <= NEAR_SECTION_M
    return bool(is_close and section.along(path).min() > 0.0)


def heights_at(
    grid: Grid, heights: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the bilinear height [m], (n,), at points x, y [m], (n, 2); clamped at the border."""
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


def _cycle_name(record: SiteRecord, cycle: int) -> str:
    return f"cycle {cycle}" if record.is_finished(cycle) else "unfinished cycle"


def _phases(record: SiteRecord) -> list[str]:
    """Return the phases in the order of their first occurrence."""
    return list(dict.fromkeys(record.lip_phase.tolist()))


def _phase_lines(
    record: SiteRecord, points: NDArray[np.float64], colours: dict[str, str]
) -> LineCollection:
    """Return a path (n, 2) as one line for each section in one phase, joined to the next."""
    phase = record.lip_phase
    starts = np.flatnonzero(phase[1:] != phase[:-1]) + 1
    bounds = [0, *starts.tolist(), len(points)] if len(points) else [0]
    sections = sorted(pairwise(bounds), key=lambda ends: phase[ends[0]] == "dig")  # on top
    return LineCollection(
        [points[first : last + 1] for first, last in sections],
        colors=[colours[str(phase[first])] for first, _ in sections],
        linewidths=[1.7 if phase[first] == "dig" else 1.1 for first, _ in sections],
        capstyle="round",
        zorder=5,
    )


def _travelled(record: SiteRecord) -> NDArray[np.float64]:
    """Return the length of the path up to each point [m], shape (n,); [0.] without a path."""
    steps = np.linalg.norm(np.diff(record.lip_path, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])

"""Plan view of the ground: colours by height, hillshade and contours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Polygon, Rectangle
from numpy.typing import NDArray

from earthmoving_sim.pictures.map_window import Window
from earthmoving_sim.pictures.site_record import SiteRecord
from earthmoving_sim.pictures.style import (
    GREY,
    HEIGHT_COLOURS,
    INK,
    SMALL,
    halo,
    nice_length,
    nice_step,
    scale,
)

__all__ = [
    "contour_levels",
    "draw_contours",
    "draw_key_map",
    "draw_machine",
    "draw_scale_bar",
    "height_scale",
    "hillshade",
    "surface_image",
    "surface_normals",
]


SUN_AZIMUTH, SUN_HEIGHT = 135.0, 45.0  # [deg]; from the upper left, as on printed maps
RELIEF = 1.5  # vertical exaggeration of the hillshade, so that gentle slopes show
MIN_LABELLED_LENGTH = 0.2  # length of a contour with a label, as a fraction of the longest side
MIN_LABEL_DISTANCE = 0.06  # distance between labels, as a fraction of the longest side
MIN_SHADE, MAX_SHADE = 0.62, 1.15  # limits of the hillshade, so that colours can be read


def surface_normals(heights: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """Return the unit normals of a surface given as an image [m], shape (height, width, 3)."""
    rise_y, rise_x = np.gradient(heights, cell)
    normal = np.stack([-rise_x, -rise_y, np.ones_like(heights)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True), dtype=np.float64)


def hillshade(
    colours: NDArray[np.float64],
    heights: NDArray[np.float64],
    cell: float,
    strength: float = 0.7,
) -> NDArray[np.float64]:
    """Return colours (height, width, 3) shaded by the slope; level ground keeps its colour."""
    azimuth, height = np.radians([SUN_AZIMUTH, SUN_HEIGHT])
    sun = np.array(
        [np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)]
    )
    facing = surface_normals(RELIEF * heights, cell) @ sun / sun[2]
    light = np.clip(1.0 + strength * (facing - 1.0), MIN_SHADE, MAX_SHADE)
    return np.asarray(np.clip(colours * light[..., None], 0.0, 1.0), dtype=np.float64)


def height_scale(window: Window, *heights: NDArray[np.float64]) -> Normalize:
    """Return the colour scale for matrices of heights [m] inside a window."""
    cropped = [window.crop(each) for each in heights]
    return scale(min(float(h.min()) for h in cropped), max(float(h.max()) for h in cropped))


def contour_levels(limits: Normalize, max_steps: int) -> NDArray[np.float64]:
    """Return round heights within a colour scale, with at most `max_steps` steps [m]."""
    low, high = float(limits.vmin or 0.0), float(limits.vmax or 0.0)
    step = nice_step(high - low, max_steps)
    return step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)


def surface_image(
    axes: Axes,
    window: Window,
    heights: NDArray[np.float64],
    limits: Normalize,
    *,
    levels: Sequence[float] | NDArray[np.float64] = (),
    labelled: bool = True,
) -> ScalarMappable:
    """Draw a matrix of heights [m] with colours, hillshade and contours at levels [m].

    Returns the colour scale, for a colour bar.
    """
    shown = window.crop(heights)
    colours = ScalarMappable(limits, HEIGHT_COLOURS)
    tint = HEIGHT_COLOURS(limits(shown))[..., :3]
    axes.imshow(
        hillshade(tint, shown, window.grid.cell),
        extent=window.extent,
        origin="lower",
        interpolation="bilinear",
    )
    draw_contours(axes, window, shown, levels, form="{:.{}f}" if labelled else "")
    axes.set_xlim(*window.extent[:2])
    axes.set_ylim(*window.extent[2:])
    axes.set_aspect("equal")
    return colours


def draw_contours(
    axes: Axes,
    window: Window,
    shown: NDArray[np.float64],
    levels: Sequence[float] | NDArray[np.float64],
    form: str = "{:.{}f}",
) -> None:
    """Draw contours of an image inside a window at levels [m].

    Long contours have labels: `form` formats the level and its number of decimals; "" omits them.
    """
    inside = [level for level in levels if shown.min() < level < shown.max()]
    if not inside:
        return
    step = float(np.diff(levels).min()) if len(levels) > 1 else 1.0
    digits = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    lines = axes.contour(
        window.x,
        window.y,
        shown,
        levels=inside,
        colors=INK,
        linewidths=0.5,
        linestyles="solid",
        alpha=0.65,
    )
    places = _label_places([s for segments in lines.allsegs for s in segments], window)
    if not (places and form):
        return
    texts = axes.clabel(
        lines,
        fontsize=6.5,
        fmt=lambda level: form.format(level + 0.0, digits).replace("-", "\N{MINUS SIGN}"),
        manual=places,
    )
    for text in texts or ():
        text.set_path_effects(halo(1.8))
        text.set_alpha(1.0)


def _label_places(
    lines: Sequence[NDArray[np.float64]], window: Window
) -> list[tuple[float, float]]:
    """Return label positions on long contours, each as far from other labels as possible."""
    x_min, x_max, y_min, y_max = window.extent
    side = max(window.size)
    positions: list[tuple[float, float]] = []
    for line in sorted(lines, key=_length, reverse=True):
        if _length(line) < MIN_LABELLED_LENGTH * side:
            continue
        x, y = line.T
        clearance = np.min([x - x_min, x_max - x, y - y_min, y_max - y], axis=0)
        for position in positions:
            clearance = np.minimum(clearance, np.hypot(x - position[0], y - position[1]))
        best = int(np.argmax(np.minimum(clearance, 0.25 * side)))
        if clearance[best] > MIN_LABEL_DISTANCE * side:
            positions.append((float(x[best]), float(y[best])))
    return positions


def _length(line: NDArray[np.float64]) -> float:
    """Return the length of a line through points (n, 2)."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def draw_scale_bar(axes: Axes, window: Window) -> None:
    """Draw a scale bar of a round length in the lower left."""
    length = nice_length(0.25 * window.size[0])
    x_min, _, y_min, _ = window.extent
    x, y = x_min + 0.04 * window.size[0], y_min + 0.04 * window.size[0]
    thickness = 0.008 * window.size[0]
    for i, colour in enumerate((INK, "white")):
        axes.add_patch(
            Rectangle(
                (x + 0.5 * i * length, y),
                0.5 * length,
                thickness,
                fc=colour,
                ec=INK,
                lw=0.6,
                zorder=8,
            )
        )
    axes.text(
        x + length + 0.012 * window.size[0],
        y + 0.5 * thickness,
        f"{length:g} m",
        size=SMALL,
        color=INK,
        va="center",
        path_effects=halo(),
        zorder=8,
    )


def draw_machine(axes: Axes, record: SiteRecord) -> None:
    """Draw the outlines of the machine at its final pose."""
    for _, polygon in record.machine_outline:
        axes.add_patch(
            Polygon(polygon, fc="#ffffff90", ec=INK, lw=0.9, joinstyle="round", zorder=4)
        )


def draw_key_map(axes: Axes, record: SiteRecord, window: Window) -> None:
    """Draw the whole map, small, with a frame around the window."""
    whole = Window.whole(record.grid)
    surface_image(axes, whole, record.before, height_scale(whole, record.before))
    x_min, _, y_min, _ = window.extent
    axes.add_patch(Rectangle((x_min, y_min), *window.size, fc="none", ec="white", lw=2.6))
    axes.add_patch(Rectangle((x_min, y_min), *window.size, fc="none", ec="#d55e00", lw=1.4))
    axes.set_xticks([])
    axes.set_yticks([])
    width, height = whole.size
    axes.text(
        -0.06,
        0.0,
        f"whole map\n{width:.4g} \N{MULTIPLICATION SIGN} {height:.4g} m",
        size=SMALL,
        color=GREY,
        ha="right",
        va="bottom",
        transform=axes.transAxes,
    )

"""Pit and spoil heap in 3-D, at the same scale along all axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from earthmoving_sim.coloured_mesh import ColouredMesh, merge_meshes
from earthmoving_sim.pictures.map_window import Window, window_around
from earthmoving_sim.pictures.mesh import ground_mesh
from earthmoving_sim.pictures.rasterizer import Camera, rasterize
from earthmoving_sim.pictures.shading import render
from earthmoving_sim.pictures.site_record import MIN_CHANGE_M, SiteRecord
from earthmoving_sim.pictures.style import (
    BOLD,
    DPI,
    GREY,
    INK,
    LABEL,
    add_axes,
    add_title,
    halo,
    new_figure,
    nice_length,
    save,
)

__all__ = ["best_camera", "draw_site_3d"]

WIDTH, ABOVE, BORDER = 10.5, 1.0, 0.35  # [in]
MAX_HEIGHT = 8.0  # [in]
ELEVATION = np.radians(36.0)  # high enough to look into a pit, low enough for the height of a heap
MACHINE_FACING_WEIGHT = 0.4  # weight of cameras that face the machine across its work
EXTREME_FRACTION = 0.95  # fraction of the maximum cut or fill that counts as its extreme
# Azimuths that are tried [deg], none along an edge of the block, where it would look flat; and the
# size of the small picture in which they are compared [px].
TRIAL_AZIMUTHS = [
    quarter + within for quarter in (0, 90, 180, 270) for within in (25, 35, 45, 55, 65)
]
TRIAL_PX = 160


def draw_site_3d(record: SiteRecord, path: Path, *, labels: bool = True) -> Path:
    """Write a 3-D view of the worked ground, and of the machine if it has a mesh, as PNG.

    Args:
        record: the site.
        path: path of the picture.
        labels: whether to label the deepest cut and the highest fill.

    Returns:
        The path.
    """
    window = _window(record)
    ground = ground_mesh(record, window)
    machine = record.machine_mesh
    mesh = merge_meshes(ground, machine) if machine else ground
    camera = best_camera(record, window, mesh)

    view = camera.view(mesh.points)[:, :2]
    low, size = view.min(axis=0), np.ptp(view, axis=0)
    per_metre = min((WIDTH - 2 * BORDER) / size[0], MAX_HEIGHT / size[1])  # [in]
    width, height = size * per_metre
    figure = new_figure(WIDTH, BORDER + height + 0.35 + ABOVE)
    left = 0.5 * (WIDTH - width)
    axes = add_axes(figure, left, BORDER + 0.35, width, height)
    shape = (round(height * DPI), round(width * DPI))
    picture = render(mesh, camera, low, per_metre * DPI, shape)
    axes.imshow(
        picture,
        origin="lower",
        extent=(low[0], low[0] + size[0], low[1], low[1] + size[1]),
        interpolation="none",
    )
    axes.autoscale(False)
    axes.set_axis_off()
    if labels:
        draw_labels(axes, record, window, camera)
    draw_edge_bar(axes, window, ground, camera)
    size_x, size_y = window.size
    subtitle = (
        f"{size_x:.3g} \N{MULTIPLICATION SIGN} {size_y:.3g} m of the site · heights not exaggerated"
        f" · cut {record.cut_volume:.2f} m³, fill {record.fill_volume:.2f} m³"
    )
    add_title(figure, record.title, subtitle, BORDER)
    return save(figure, path)


def _window(record: SiteRecord) -> Window:
    """Return the window around the changed columns and the machine."""
    machine = [] if record.machine_mesh is None else [record.machine_mesh.points[:, :2]]
    return window_around(record.grid, np.concatenate([record.changed_points, *machine]))


def best_camera(record: SiteRecord, window: Window, mesh: ColouredMesh) -> Camera:
    """Return the camera azimuth, of several, that shows the most of both cut and filled ground.

    Each is rated in a small picture by the smaller of the two visible areas, so that neither is
    hidden. Cameras that face the machine across its work are preferred.
    """
    change = window.crop(record.change).ravel()
    num_ground = len(change)  # points of the ground come first in the mesh
    first = np.where(mesh.triangles.max(axis=1) < num_ground, mesh.triangles.min(axis=1), -1)
    sign = np.where(first >= 0, np.sign(change[first]) * (np.abs(change[first]) > MIN_CHANGE_M), 0)
    cameras = [Camera(float(np.radians(trial)), float(ELEVATION)) for trial in TRIAL_AZIMUTHS]
    scale = TRIAL_PX / float(np.hypot(*window.size))

    work = np.zeros(2)
    if record.machine_mesh and len(record.changed_points):
        work = record.changed_points.mean(axis=0) - record.machine_origin
        work *= MACHINE_FACING_WEIGHT / max(float(np.linalg.norm(work)), 1e-9)

    def rating(camera: Camera) -> float:
        view = camera.view(mesh.points) * scale
        view -= view.min(axis=0)
        width, height = np.ceil(view[:, :2].max(axis=0)).astype(int).tolist()
        faces, _ = rasterize(view, mesh.triangles, (height + 1, width + 1))
        visible = sign[faces[faces >= 0]]
        cut, fill = int((visible < 0).sum()), int((visible > 0).sum())
        return (min(cut, fill) + 0.1 * max(cut, fill)) * (1.0 + float(camera.toward[:2] @ work))

    return max(cameras, key=rating)


def draw_labels(axes: Axes, record: SiteRecord, window: Window, camera: Camera) -> None:
    """Label the deepest cut and the highest fill, where there is one."""
    change, after = window.crop(record.change), window.crop(record.after)
    for name, sign in (("pit", -1.0), ("spoil heap", 1.0)):
        max_change = float((sign * change).max())
        if max_change <= MIN_CHANGE_M:
            continue
        # On a flat floor the far end is labelled: the rim of the pit may hide the near one.
        row, column = np.nonzero(sign * change >= EXTREME_FRACTION * max_change)
        points = np.stack([window.x[column], window.y[row], after[row, column]], axis=1)
        x, y, _ = max(camera.view(points).tolist(), key=lambda point: point[2])
        extreme = f"{max_change:.2f} m deep" if sign < 0 else f"{max_change:.2f} m high"
        axes.annotate(
            f"{name}\n{extreme}",
            (x, y),
            xytext=(0, 62),
            textcoords="offset points",
            size=BOLD,
            color=INK,
            ha="center",
            va="bottom",
            linespacing=1.35,
            path_effects=halo(3.0),
            arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.9, "shrinkA": 2, "shrinkB": 0},
            annotation_clip=False,
        )
        axes.plot(x, y, "o", ms=3.5, mfc="white", mec=INK, mew=0.9)


def draw_edge_bar(axes: Axes, window: Window, ground: ColouredMesh, camera: Camera) -> None:
    """Draw a scale bar of a round length below the longer front edge of the block."""
    floor = float(ground.points[:, 2].min())
    front = _front_corner(window, camera)
    along = _longest_front_edge(window, camera, front)
    length = nice_length(0.3 * float(np.linalg.norm(along)))
    unit = along / np.linalg.norm(along)
    start = front + 0.06 * along
    ends = np.array([[*start, floor], [*(start + length * unit), floor]])
    (x0, y0), (x1, y1) = camera.view(ends)[:, :2] - [0.0, 0.25]
    axes.plot([x0, x1], [y0, y1], color=INK, lw=2.2, solid_capstyle="butt", clip_on=False)
    axes.annotate(
        f"{length:g} m along {'x' if abs(unit[0]) > 0.5 else 'y'}",
        (0.5 * (x0 + x1), 0.5 * (y0 + y1)),
        xytext=(0, -6),
        textcoords="offset points",
        size=LABEL,
        color=GREY,
        ha="left" if (y1 - y0) * (x1 - x0) > 0 else "right",
        va="top",
        annotation_clip=False,
    )


def _front_corner(window: Window, camera: Camera) -> NDArray[np.float64]:
    """Return x, y of the block's corner nearest to the camera [m], shape (2,)."""
    x_min, x_max, y_min, y_max = window.extent
    toward = camera.toward
    return np.array([x_max if toward[0] > 0 else x_min, y_max if toward[1] > 0 else y_min])


def _longest_front_edge(
    window: Window, camera: Camera, front: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the edge from the front corner that appears longest, x, y [m], shape (2,)."""
    x_min, x_max, y_min, y_max = window.extent
    edges = (
        np.array([x_min + x_max - 2 * front[0], 0.0]),
        np.array([0.0, y_min + y_max - 2 * front[1]]),
    )
    return max(edges, key=lambda edge: abs(float(camera.view(np.append(edge, 0.0)[None])[0, 0])))

"""Draw what the soil does: piles of every soil, walls that fail and stand, a pit, ruts.

    python -m benchmarks.soil_gallery [FOLDER]

Writes soils_piles.png, soils_trench.png, soils_pit.png and soils_ruts.png into FOLDER, or into
out/soils/.
"""

from __future__ import annotations

import argparse
import io
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from benchmarks.bucket_sweeps import NO_DEPOSIT_REQUESTS, NO_SWEEPS
from benchmarks.soil_scenes import (
    make_pile,
    make_pit,
    make_ruts,
    make_trench,
    measure_pile_angle,
    step_until_at_rest,
)
from earthmoving_sim.pictures.map_window import Window
from earthmoving_sim.pictures.mesh import ground_mesh
from earthmoving_sim.pictures.rasterizer import Camera
from earthmoving_sim.pictures.shading import render
from earthmoving_sim.pictures.site_record import SiteRecord
from earthmoving_sim.pictures.style import (
    BOLD,
    DPI,
    GREY,
    INK,
    LABEL,
    add_axes,
    add_title,
    new_figure,
)
from soil_sim.columns.state import SurfaceMaterial
from soil_sim.soil import Soil
from soil_sim.soils.soil_types import load_soil_types

GRASS = (0.44, 0.51, 0.30)
EXCAVATED_SHADE = 0.80
"""Brightness of firm soil laid bare, relative to the same soil loose."""
WET_SHADE = 0.45
"""Brightness of saturated soil: it reflects about half as much light as dry soil."""
EXPOSURE = 0.88
"""Factor on soil colours, so that light soil in the sun is not white."""
NUM_COLOURS = 128
"""Number of colours of a file."""


def ground_colours(soil: Soil) -> NDArray[np.float64]:
    """Return the colour of each column, shape (rows, cols, 3): grass or soil, darker if moist."""
    columns = soil.columns
    colours = np.array([kind.colour for kind in soil.soil_types])[columns.top_soil]
    is_excavated = columns.material == SurfaceMaterial.EXCAVATED
    colours = np.where(is_excavated[..., None], EXCAVATED_SHADE * colours, colours)
    moisture = columns.moisture[..., None] / 100.0
    colours = EXPOSURE * colours * (1.0 - (1.0 - WET_SHADE) * moisture)
    is_grass = (columns.material == SurfaceMaterial.UNDISTURBED) & ~_is_at_edge(soil)
    return np.asarray(np.where(is_grass[..., None], GRASS, colours), dtype=np.float64)


def _is_at_edge(soil: Soil) -> NDArray[np.bool_]:
    """Return a mask of columns beside a much lower one, of which the cut face is visible."""
    height = np.pad(soil.columns.height, 1, mode="edge")
    rows, cols = soil.grid.shape
    neighbours = [
        height[1 + i : 1 + i + rows, 1 + j : 1 + j + cols] for i in (-1, 0, 1) for j in (-1, 0, 1)
    ]
    drop = soil.columns.height - np.min(neighbours, axis=0)
    return np.asarray(drop > 2.0 * soil.grid.cell, dtype=np.bool_)


def draw_terrain(
    figure: Figure,
    corner: tuple[float, float],
    width: float,
    soil: Soil,
    camera: Camera,
    exaggeration: float = 1.0,
) -> Axes:
    """Draw a terrain as a block.

    Args:
        figure: the figure to draw into.
        corner: left and bottom of the picture [in].
        width: width of the picture [in].
        soil: the terrain.
        camera: direction of view.
        exaggeration: factor on heights.
    """
    window = Window.whole(soil.grid)
    height = exaggeration * soil.columns.height
    record = SiteRecord(
        grid=soil.grid,
        before=height,
        after=height,
        loose_depth=soil.columns.loose_depth,
        lip_path=np.empty((0, 3)),
        lip_cycle=np.empty(0, dtype=np.int64),
        lip_phase=np.empty(0, dtype=np.str_),
        machine_outline=(),
        title="",
    )
    mesh = ground_mesh(record, window)
    colours = ground_colours(soil)
    surface = np.stack([window.crop(colours[..., k]) for k in range(3)], axis=-1).reshape(-1, 3)
    mesh = replace(mesh, colours=np.concatenate([surface, mesh.colours[len(surface) :]]))
    projected = camera.view(mesh.points)[:, :2]
    low, size = projected.min(axis=0), np.ptp(projected, axis=0)
    inches_per_metre = width / size[0]
    height_in = size[1] * inches_per_metre
    axes = add_axes(figure, *corner, width, height_in)
    shape = (round(height_in * DPI), round(width * DPI))
    image = render(mesh, camera, low, inches_per_metre * DPI, shape)
    axes.imshow(image, origin="lower", aspect="auto")
    axes.set_axis_off()
    return axes


def add_caption(axes: Axes, name: str, line: str) -> None:
    """Add a name and a line of figures below a picture."""
    axes.text(0.5, -0.02, name, size=BOLD, weight="bold", color=INK,
              ha="center", va="top", transform=axes.transAxes)  # fmt: skip
    axes.annotate(line, (0.5, -0.02), xytext=(0, -15), textcoords="offset points", size=LABEL,
                  color=GREY, ha="center", va="top", xycoords="axes fraction")  # fmt: skip


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG with a palette, which is small, and print its size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=DPI, format="png")
    picture = Image.open(buffer).convert("RGB")
    picture.quantize(NUM_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}  {path.stat().st_size / 1000:.0f} kB")


def draw_piles(path: Path) -> None:
    """Draw piles of all shipped soils with the angle of repose and the measured angle."""
    width, gap, row_height = 2.75, 0.2, 1.95
    figure = new_figure(0.3 + 3 * (width + gap), 1.0 + 3 * row_height)
    camera = Camera(math.radians(-60.0), math.radians(24.0))
    for n, (name, kind) in enumerate(load_soil_types().items()):
        soil = make_pile(name)
        corner = (0.3 + n % 3 * (width + gap), 0.5 + (2 - n // 3) * row_height)
        expected = math.degrees(kind.repose_angle_at(kind.moisture))
        measured = measure_pile_angle(soil)
        axes = draw_terrain(figure, corner, width, soil, camera)
        figures = f"{kind.moisture} % moist · repose {expected:.1f}°, pile {measured:.1f}°"
        add_caption(axes, name, figures)
        print(f"  {name}: angle of repose {expected:.2f} deg, pile {measured:.2f} deg")
    about = "6.5 × 6.5 m each, 0.1 m cells, at the shipped moisture"
    add_title(figure, "Piles of the shipped soils", about, 0.3)
    write_png(figure, path)


def draw_trench(path: Path) -> None:
    """Draw a trench in sand while its walls fail, and one in clay that stands."""
    width, gap, row_height = 4.1, 0.3, 3.15
    figure = new_figure(0.3 + 2 * (width + gap), 1.15 + 2 * row_height)
    camera = Camera(math.radians(22.0), math.radians(26.0))
    corners = [(0.3 + i * (width + gap), 0.55 + j * row_height) for j in (1, 0) for i in (0, 1)]
    failed = make_trench("dry sand")
    ticks = step_until_at_rest(failed)
    half_of_loose = failed.columns.loose.sum() / 2
    sand = make_trench("dry sand")
    axes = draw_terrain(figure, corners[0], width, sand, camera)
    add_caption(axes, "dry sand, as cut", "walls 1.5 m high, 0.1 m cells")
    tick = 0
    while sand.columns.loose.sum() < half_of_loose:
        sand.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        tick += 1
    axes = draw_terrain(figure, corners[1], width, sand, camera)
    add_caption(axes, "dry sand, during failure", "half of the volume has failed")
    loose = failed.columns.loose.sum() / 1e9
    axes = draw_terrain(figure, corners[2], width, failed, camera)
    add_caption(axes, "dry sand, at rest", f"{loose:.1f} m³ failed; slope 34°")
    clay = make_trench("dry clay")
    step_until_at_rest(clay)
    height = clay.soil_types[0].critical_height(0)
    axes = draw_terrain(figure, corners[3], width, clay, camera)
    add_caption(axes, "dry clay, at rest", f"critical height {height:.1f} m; nothing failed")
    print(
        f"  sand failed for {ticks} ticks, half of it by tick {tick};"
        f" clay lost {clay.columns.loose.sum()} mm^3"
    )
    add_title(figure, "A trench in sand and in clay", "4.9 × 7.1 m, heights to scale", 0.3)
    write_png(figure, path)


def draw_pit(path: Path) -> None:
    """Draw a pit and its heaps, coloured by material and moisture."""
    soil = make_pit()
    width = 7.8
    figure = new_figure(width + 0.6, 6.5)
    camera = Camera(math.radians(-62.0), math.radians(35.0))
    draw_terrain(figure, (0.3, 0.55), width, soil, camera)
    loose = EXPOSURE * np.array(soil.soil_types[0].colour)
    colours = {
        "undisturbed": GRASS,
        "excavated, dry": EXCAVATED_SHADE * loose,
        "loose, dry": loose,
        "excavated, wet": EXCAVATED_SHADE * WET_SHADE * loose,
        "loose, wet": WET_SHADE * loose,
    }
    legend = add_axes(figure, 0.3, 0.12, width, 0.3)
    for n, (name, colour) in enumerate(colours.items()):
        legend.scatter(n, 0, s=110, marker="s", color=[colour], edgecolors=GREY, linewidths=0.6)
        legend.text(n + 0.1, 0, name, size=LABEL, color=INK, va="center")
    legend.set_xlim(-0.3, 4.8)
    legend.set_axis_off()
    num_excavated = int((soil.columns.material == SurfaceMaterial.EXCAVATED).sum())
    num_loose = int((soil.columns.material == SurfaceMaterial.LOOSE).sum())
    print(
        f"  {num_excavated} excavated columns, {num_loose} with loose soil,"
        f" volume verified: {soil.verify_volume()}"
    )
    about = "8.5 × 7.3 m, 0.06 m cells; one half dry, one half wet"
    add_title(figure, "Surface materials: a pit in loam and its heaps", about, 0.3)
    write_png(figure, path)


def draw_ruts(path: Path) -> None:
    """Draw the ruts of tracks in wet soil."""
    soil = make_ruts()
    width = 7.8
    figure = new_figure(width + 0.6, 6.4)
    camera = Camera(math.radians(-62.0), math.radians(38.0))
    draw_terrain(figure, (0.3, 0.3), width, soil, camera, 6.0)
    depth = -float(soil.columns.height.min())
    print(f"  ruts up to {depth:.3f} m deep, volume verified: {soil.verify_volume()}")
    about = (
        f"15 × 9 m, 0.1 m cells; firm loam, saturated; up to {1e3 * depth:.0f} mm deep; heights × 6"
    )
    add_title(figure, "Ruts behind an excavator", about, 0.3)
    write_png(figure, path)


def main() -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", default=Path("out/soils"), help="folder to write into"
    )
    folder = parser.parse_args().folder
    draw_piles(folder / "soils_piles.png")
    draw_trench(folder / "soils_trench.png")
    draw_pit(folder / "soils_pit.png")
    draw_ruts(folder / "soils_ruts.png")


if __name__ == "__main__":
    main()

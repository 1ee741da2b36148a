"""Pictures of what the soil does: a pile of every kind, walls that fall and stand, a pit, ruts.

Writes soils_piles.png, soils_trench.png, soils_pit.png and soils_ruts.png into a folder, out/soils/
if none is given. Run from the repository root: `python benchmarks/soil_gallery.py [FOLDER]`.
"""

from __future__ import annotations

import argparse
import io
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

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
from earthmoving_sim.world import World
from machine_sim.machine import load_machine_spec
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, ConversionKind, Rows, empty_rows
from soil_sim.columns.state import SurfaceMaterial
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import load_soil_types

NO_SWEEPS, NO_DEPOSIT_REQUESTS = empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST)

GRASS = (0.44, 0.51, 0.30)
DUG_SHADE = 0.80  # firm soil laid bare is darker than the same soil loose
WET_SHADE = 0.45  # saturated soil reflects about half of what dry soil does
EXPOSURE = 0.88  # or pale soil in the sun would be white
COLOURS_KEPT = 128  # of a picture's file

BUCKET = ((0.0, 0.0), (-0.4, 0.0), (-0.7, 0.1), (-0.9, 0.3), (-1.0, 0.5), (-1.0, 0.8), (-0.9, 1.0))
"""(x, z) of a bucket's key points behind and above its lip [m]."""


# What is shown


def landings(x: float, y: float, volumes: NDArray[np.integer], moisture: int) -> Rows:
    """Return DEPOSIT_REQUEST rows at one position [m] with volumes [mm^3] and a moisture [%]."""
    rows = empty_rows(DEPOSIT_REQUEST, volumes.size)
    rows["x"], rows["y"], rows["volume_mm3"] = x, y, volumes
    rows["moisture"], rows["machine_id"] = moisture, 1
    rows["particle_id"] = np.arange(1, volumes.size + 1)
    return rows


def bucket(start: NDArray[np.float64], end: NDArray[np.float64], width: float = 1.2) -> Rows:
    """SWEEP rows of a bucket whose lip's middle moves from start to end, x, y, z [m]."""
    rows = empty_rows(SWEEP, 2 * len(BUCKET))
    for n, (x, z) in enumerate(BUCKET):
        for side, y in ((0, width / 2), (1, -width / 2)):
            row = rows[2 * n + side]
            row["pair"], row["machine_id"] = n, 1
            for axis, offset, a, b in zip("xyz", (x, y, z), start, end, strict=True):
                row[f"{axis}0"], row[f"{axis}1"] = a + offset, b + offset
    return rows


def pile(name: str, reach: float = 2.0, parts: int = 800) -> Soil:
    """A pile of a shipped soil, as found, that a cone of its angle makes `reach` [m] in radius."""
    kind = load_soil_types()[name]
    grid = Grid(65, 65, 0.1)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil=name))
    bulk = math.pi / 3 * math.tan(kind.repose_angle_at(kind.moisture)) * reach**3
    volumes = np.array([round(bulk * 1e9 / (1 + kind.swell) / parts)])
    for tick in range(parts):
        soil.step(tick, NO_SWEEPS, landings(0.0, 0.0, volumes, kind.moisture))
    at_rest(soil)
    return soil


def measured_angle(soil: Soil) -> float:
    """Angle [deg] of a pile's flank, from 0.2 to 0.8 of its height."""
    grid, height = soil.grid, soil.columns.height
    away = np.hypot(grid.x(np.arange(grid.rows))[:, None], grid.y(np.arange(grid.cols))[None, :])
    part = (height > 0.2 * height.max()) & (height < 0.8 * height.max())
    return math.degrees(math.atan(-np.polyfit(away[part], height[part], 1)[0]))


def trench(name: str) -> Soil:
    """A trench across the map, 1.5 m deep, that begins to slip; in slow motion."""
    grid = Grid(49, 71, 0.1)
    heights = np.zeros(grid.shape)
    heights[:, np.abs(grid.y(np.arange(grid.cols))) < 0.8] = -1.5
    soil = Soil(grid, heights, SoilParams(soil=name, max_cell_visits_per_tick=100))
    soil.columns.material[heights < 0.0] = SurfaceMaterial.EXCAVATED
    soil.relaxation.mark_all_disturbed()
    return soil


def at_rest(soil: Soil) -> int:
    """Let a terrain come to rest; returns the ticks that took."""
    ticks = 0
    while soil.relaxation.num_pending:
        soil.step(ticks, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        ticks += 1
    return ticks


def dug_pit() -> Soil:
    """A pit in loam, dry on one side and wet on the other, and beside it heaps of what was dug."""
    grid = Grid(141, 121, 0.06)
    x, y = np.meshgrid(grid.x(np.arange(141)), grid.y(np.arange(121)), indexing="ij")
    rng = np.random.default_rng(3)
    hills = sum(
        0.03 * np.sin(x * rng.normal() + y * rng.normal() + rng.uniform(0, 6)) for _ in range(8)
    )
    wet = np.clip(50.0 - 70.0 * y, 0.0, 95.0)
    soil = Soil(grid, np.asarray(hills), SoilParams(soil="loam"), moisture=np.rint(wet).astype(int))
    tick, dug, moist, side = 0, [], [], []
    for across in (0.55, -0.55):
        for depth in (0.35, 0.7, 1.0):
            path = np.array(
                [(-2.2, 0.3), (-2.0 + 0.3 * depth, -depth), (0.2 - 0.4 * depth, -depth), (0.6, 0.5)]
            )
            steps = np.concatenate(
                [np.linspace(a, b, 60, endpoint=False) for a, b in pairwise(path)]
            )
            lip = np.stack([steps[:, 0], np.full(len(steps), across), steps[:, 1]], axis=1)
            for a, b in pairwise(lip):
                rows = soil.step(tick, bucket(a, b), NO_DEPOSIT_REQUESTS).conversions
                rows = rows[rows["kind"] == ConversionKind.EXCAVATE]
                dug.append(rows["volume_mm3"].astype(np.int64))
                moist.append(soil.columns.moisture[rows["row"], rows["col"]])
                side.append(np.full(rows.size, across))
                tick += 1
    volumes, wetness, sides = np.concatenate(dug), np.concatenate(moist), np.concatenate(side)
    for n in range(0, volumes.size, 100):
        some = slice(n, n + 100)
        mean = round(float(np.average(wetness[some], weights=volumes[some] + 1.0)))
        x_at, y_at = rng.normal((2.4, 2.6 * float(sides[n])), 0.12)
        whole = np.array([volumes[some].sum()])
        soil.step(tick, NO_SWEEPS, landings(x_at, y_at, whole, mean))
        tick += 1
    at_rest(soil)
    return soil


def rutted() -> Soil:
    """Loose loam over which an excavator drove ahead, to the left, and ahead again."""
    grid, depth = Grid(151, 91, 0.1), 0.25
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil="loam"))
    growth = 1.0 + soil.soil_types[0].swell
    x, y = np.meshgrid(grid.x(np.arange(151)), grid.y(np.arange(91)), indexing="ij")
    volumes = np.full(grid.rows * grid.cols, round(depth / growth / soil.columns.metres_per_mm3))
    spread = landings(0.0, 0.0, volumes, soil.soil_types[0].moisture)
    spread["x"], spread["y"] = x.reshape(-1), y.reshape(-1)
    soil.step(0, NO_SWEEPS, spread)
    machine = MachineSim(
        [Placement(load_machine_spec(find_config("machines/excavator.yaml")), (-5.0, -1.5))],
        grid,
        soil.columns.height,
        soils=soil.loose_soils,
    )
    world = World(soil, {1: machine})
    for left, right, ticks in ((1.0, 1.0, 350), (0.55, 1.0, 350), (1.0, 1.0, 200)):
        machine.command(np.zeros(4), np.array([left, right]))
        for _ in range(ticks):
            world.step()
    world.close()
    return soil


# How it is drawn


def ground_colours(soil: Soil) -> NDArray[np.float64]:
    """Of each column, shape (rows, cols, 3): grass, or the soil's colour, darker where moist."""
    columns = soil.columns
    own = np.array([kind.colour for kind in soil.soil_types])[columns.top_soil]
    own = np.where((columns.material == SurfaceMaterial.EXCAVATED)[..., None], DUG_SHADE * own, own)
    own = EXPOSURE * own * (1.0 - (1.0 - WET_SHADE) * columns.moisture[..., None] / 100.0)
    grass = (columns.material == SurfaceMaterial.UNDISTURBED) & ~_on_edge(soil)
    return np.asarray(np.where(grass[..., None], GRASS, own), dtype=np.float64)


def _on_edge(soil: Soil) -> NDArray[np.bool_]:
    """Columns beside one that is much lower: what is seen of them is the face they are cut in."""
    height = np.pad(soil.columns.height, 1, mode="edge")
    rows, cols = soil.grid.shape
    around = [height[1 + i : 1 + i + rows, 1 + j : 1 + j + cols]
              for i in (-1, 0, 1) for j in (-1, 0, 1)]  # fmt: skip
    fall = soil.columns.height - np.min(around, axis=0)
    return np.asarray(fall > 2.0 * soil.grid.cell, dtype=np.bool_)


def draw(
    figure: Figure,
    place: tuple[float, float],
    width: float,
    soil: Soil,
    view: Camera,
    times: float = 1.0,
) -> Axes:
    """Draw a terrain, its heights so many times as large, as a block.

    The picture is `width` wide and begins at left, bottom [in].
    """
    window = Window.whole(soil.grid)
    height = times * soil.columns.height
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
    seen = np.stack([window.crop(colours[..., k]) for k in range(3)], axis=-1).reshape(-1, 3)
    mesh = replace(mesh, colours=np.concatenate([seen, mesh.colours[len(seen) :]]))
    place_in_view = view.view(mesh.points)[:, :2]
    low, size = place_in_view.min(axis=0), np.ptp(place_in_view, axis=0)
    per_metre = width / size[0]
    tall = size[1] * per_metre
    axes = add_axes(figure, *place, width, tall)
    shape = (round(tall * DPI), round(width * DPI))
    axes.imshow(render(mesh, view, low, per_metre * DPI, shape), origin="lower", aspect="auto")
    axes.set_axis_off()
    return axes


def caption(axes: Axes, name: str, line: str) -> None:
    """A name and a line of figures below a picture."""
    axes.text(0.5, -0.02, name, size=BOLD, weight="bold", color=INK,
              ha="center", va="top", transform=axes.transAxes)  # fmt: skip
    axes.annotate(line, (0.5, -0.02), xytext=(0, -15), textcoords="offset points", size=LABEL,
                  color=GREY, ha="center", va="top", xycoords="axes fraction")  # fmt: skip


def write(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG of few colours, which is small."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = io.BytesIO()
    figure.savefig(whole, dpi=DPI, format="png")
    picture = Image.open(whole).convert("RGB")
    picture.quantize(COLOURS_KEPT, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}  {path.stat().st_size / 1000:.0f} kB")


def draw_piles(path: Path) -> None:
    """Piles of all shipped soils, with the angle asked and the angle measured."""
    wide, gap, row = 2.75, 0.2, 1.95
    figure = new_figure(0.3 + 3 * (wide + gap), 1.0 + 3 * row)
    view = Camera(math.radians(-60.0), math.radians(24.0))
    for n, (name, kind) in enumerate(load_soil_types().items()):
        soil = pile(name)
        place = (0.3 + n % 3 * (wide + gap), 0.5 + (2 - n // 3) * row)
        asked, found = math.degrees(kind.repose_angle_at(kind.moisture)), measured_angle(soil)
        axes = draw(figure, place, wide, soil, view)
        caption(axes, name, f"{kind.moisture} % moist · {asked:.1f}° asked, {found:.1f}° measured")
        print(f"  {name}: {asked:.2f} deg asked, {found:.2f} measured")
    add_title(figure, "Piles of the shipped soils", "6.5 × 6.5 m each, 0.1 m cells, as found", 0.3)
    write(figure, path)


def draw_trench(path: Path) -> None:
    """A trench in sand as it falls in, and one in clay that stands."""
    wide, gap, row = 4.1, 0.3, 3.15
    figure = new_figure(0.3 + 2 * (wide + gap), 1.15 + 2 * row)
    view = Camera(math.radians(22.0), math.radians(26.0))
    places = [(0.3 + i * (wide + gap), 0.55 + j * row) for j in (1, 0) for i in (0, 1)]
    fallen = trench("dry sand")
    ticks = at_rest(fallen)
    half = fallen.columns.loose.sum() / 2
    sand = trench("dry sand")
    axes = draw(figure, places[0], wide, sand, view)
    caption(axes, "dry sand, as cut", "walls 1.5 m high, 0.1 m cells")
    tick = 0
    while sand.columns.loose.sum() < half:
        sand.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        tick += 1
    caption(draw(figure, places[1], wide, sand, view), "dry sand, half way", "half has fallen")
    loose = fallen.columns.loose.sum() / 1e9
    axes = draw(figure, places[2], wide, fallen, view)
    caption(axes, "dry sand, at rest", f"{loose:.1f} m³ fell; it lies at 34°")
    clay = trench("dry clay")
    at_rest(clay)
    stands = clay.soil_types[0].critical_height(0)
    axes = draw(figure, places[3], wide, clay, view)
    caption(axes, "dry clay, at rest", f"a cut of it stands up to {stands:.1f} m; nothing fell")
    print(
        f"  sand fell for {ticks} slow ticks, half by {tick}; clay lost {clay.columns.loose.sum()}"
    )
    add_title(figure, "A trench in sand and in clay", "4.9 × 7.1 m, heights not exaggerated", 0.3)
    write(figure, path)


def draw_pit(path: Path) -> None:
    """A pit and its heaps, coloured by material and moisture."""
    soil = dug_pit()
    wide = 7.8
    figure = new_figure(wide + 0.6, 6.5)
    draw(figure, (0.3, 0.55), wide, soil, Camera(math.radians(-62.0), math.radians(35.0)))
    own = EXPOSURE * np.array(soil.soil_types[0].colour)
    keys = (("untouched", GRASS), ("dug, dry", DUG_SHADE * own), ("dirt, dry", own),
            ("dug, wet", DUG_SHADE * WET_SHADE * own), ("dirt, wet", WET_SHADE * own))  # fmt: skip
    legend = add_axes(figure, 0.3, 0.12, wide, 0.3)
    for n, (name, colour) in enumerate(keys):
        legend.scatter(n, 0, s=110, marker="s", color=[colour], edgecolors=GREY, linewidths=0.6)
        legend.text(n + 0.1, 0, name, size=LABEL, color=INK, va="center")
    legend.set_xlim(-0.3, 4.8)
    legend.set_axis_off()
    dug = int((soil.columns.material == SurfaceMaterial.EXCAVATED).sum())
    dirt = int((soil.columns.material == SurfaceMaterial.LOOSE).sum())
    print(f"  {dug} columns laid bare, {dirt} under dirt, verified {soil.verify_volume()}")
    about = "8.5 × 7.3 m, 0.06 m cells; half of it dry, half of it wet"
    add_title(figure, "What a surface looks like: a pit in loam and its heaps", about, 0.3)
    write(figure, path)


def draw_ruts(path: Path) -> None:
    """Where tracks went over loose soil."""
    soil = rutted()
    wide = 7.8
    figure = new_figure(wide + 0.6, 6.4)
    draw(figure, (0.3, 0.3), wide, soil, Camera(math.radians(-62.0), math.radians(38.0)), 6.0)
    print(
        f"  ruts to {0.25 - float(soil.columns.height.min()):.3f} m, verified"
        f" {soil.verify_volume()}"
    )
    about = (
        "15 × 9 m, 0.1 m cells; 0.25 m of loose loam, packed toward bank density; heights six times"
    )
    add_title(figure, "Ruts behind an excavator", about, 0.3)
    write(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/soils"))
    folder = parser.parse_args().folder
    draw_piles(folder / "soils_piles.png")
    draw_trench(folder / "soils_trench.png")
    draw_pit(folder / "soils_pit.png")
    draw_ruts(folder / "soils_ruts.png")


if __name__ == "__main__":
    main()

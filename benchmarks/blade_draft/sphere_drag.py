"""Drag a blade through a bed of spheres in LIGGGHTS."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from benchmarks.blade_draft.blade import HEIGHT, SPEED, Blade, Drag
from benchmarks.liggghts_runner import run_program
from benchmarks.sphere_bed import PACKING, SphereBed, write_mesh

__all__ = ["RADIUS", "drag_in_spheres", "write_input"]

RADIUS = 0.015
"""Radius of the spheres [m]."""

_BULK_DENSITY = 1500.0
"""Density of the bed at `PACKING` [kg/m^3]; it settles to 1440."""

_LENGTH, _START = 2.0, 0.45
"""Length of the bed, and first position of the edge in it [m]."""

_BELOW = 0.12
"""Depth of the bed below the edge [m]."""

_BESIDE = 3.0
"""Bed beside the blade on each side [depths of the edge]."""

_PLANE_WIDTH = 0.24
"""Width of the bed, and of the blade in it, where the bed continues at its sides [m]."""

_SETTLING_TIME, _LEVELLING_TIME = 0.7, 0.2
"""Times in which the spheres come to rest, before and after the bed is levelled [s]."""

_NUM_MEANS = 300
"""Number of means of the force over the travel."""

_TIME_LIMIT = 2.0 * 3600.0  # [s]


def drag_in_spheres(
    blade: Blade, tool_friction: float, travel: float, radius: float, folder: Path
) -> Drag:
    """Return the forces on a blade in a bed of spheres.

    Args:
        blade: the blade; its soil does not count.
        tool_friction: angle of friction of spheres on it [deg].
        travel: distance [m].
        radius: of the spheres [m].
        folder: folder for the files of LIGGGHTS.

    Raises:
        LiggghtsError: LIGGGHTS is not installed or failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    width = write_input(blade, tool_friction, travel, radius, folder)
    run_program(folder, _TIME_LIMIT)
    means = np.loadtxt(folder / "force.txt")
    per_metre = 1.0 if math.isfinite(blade.width) else width
    return Drag(
        travel * np.arange(1, len(means) + 1) / len(means),
        -means[:, 1] / per_metre,
        means[:, 3] / per_metre,
    )


def write_input(
    blade: Blade, tool_friction: float, travel: float, radius: float, folder: Path
) -> float:
    """Write the files of a run into a folder; return the width of the blade [m]."""
    is_plane = not math.isfinite(blade.width)
    width = _PLANE_WIDTH if is_plane else blade.width
    half = 0.5 * width if is_plane else 0.5 * width + _BESIDE * blade.depth
    depth = blade.depth + _BELOW
    # A lattice at this height settles to a bed that is a little deeper.
    poured = depth * 1.08 * PACKING / (math.pi / 6.0) * (2.06 / 2.0) ** 3
    bed = SphereBed(
        (0.0, _LENGTH), (-half, half), depth, poured, _BULK_DENSITY, tool_friction, radius, is_plane
    )
    bed.write_spheres(folder / "data.txt")
    _write_blade(blade, width, folder / "tool.stl")
    every = bed.steps_in(travel / SPEED / _NUM_MEANS)
    timestep = travel / SPEED / _NUM_MEANS / every
    settling, levelling = (round(time / timestep) for time in (_SETTLING_TIME, _LEVELLING_TIME))
    # Means are over whole multiples of `every` steps.
    levelling += -(settling + levelling) % every
    lines = [
        *bed.commands(timestep, settling, levelling),
        f"fix force all ave/time 1 {every} {every} f_tool[1] f_tool[2] f_tool[3] file force.txt",
        f"fix slide all move/mesh mesh tool linear {SPEED:.9g} 0. 0.",
        f"run {every * _NUM_MEANS}",
    ]
    (folder / "in.txt").write_text("\n".join([*lines, ""]))
    return width


def _write_blade(blade: Blade, width: float, path: Path) -> None:
    """Write the blade as two triangles."""
    half = 0.5 * width - 1e-6  # within a bed that continues at its sides
    top = _START - HEIGHT / math.tan(math.radians(blade.rake))
    a, b, c, d = (
        np.array([x, y, z])
        for x, y, z in (
            (_START, half, -blade.depth),
            (_START, -half, -blade.depth),
            (top, -half, HEIGHT - blade.depth),
            (top, half, HEIGHT - blade.depth),
        )
    )
    write_mesh(path, [(a, b, c), (a, c, d)])

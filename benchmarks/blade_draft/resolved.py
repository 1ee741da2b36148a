"""Drags in a bed of spheres in LIGGGHTS: which ones, and their recorded forces."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.blade_draft.blade import Blade
from benchmarks.blade_draft.drag import drag_blade
from benchmarks.blade_draft.sphere_drag import drag_in_spheres

__all__ = ["RECORDED", "WINDOWS", "ResolvedDrag", "read_drags", "record_drags", "simulate_drag"]

RECORDED = Path(__file__).parents[2] / "validation" / "resolved_blade.csv"
"""Table of the recorded forces."""

WINDOWS = ((0.05, 0.15), (0.15, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9))
"""Ranges of the travel over which forces are averaged [m]."""

_DEPTH, _CELL = 0.2, 0.05
_TOOL_FRICTION = {"spheres": 20.0, "spheres, rough blade": 26.6}
"""Angle of friction on the blade [deg], by the sand of `sands.yaml`; 26.6 is that of spheres."""

_BLADES = [
    Blade(width, _DEPTH, rake, sand)
    for width, rake, sand in (
        (math.inf, 90.0, "spheres"),
        (math.inf, 90.0, "spheres, rough blade"),
        (math.inf, 60.0, "spheres"),
        (0.4, 90.0, "spheres"),
        (0.4, 60.0, "spheres"),
        (0.2, 90.0, "spheres"),
        (0.2, 60.0, "spheres"),
    )
]
"""The drags: a wide blade and blades of two and one depths, upright and inclined."""


class ResolvedDrag(NamedTuple):
    """Forces on a blade, averaged over `WINDOWS`.

    Attributes:
        blade: the blade.
        forces: draft and lift [N], of a blade of infinite width per metre, one pair per window.
    """

    blade: Blade
    forces: list[tuple[float, float]]


def simulate_drag(blade: Blade) -> ResolvedDrag:
    """Drag a blade through the terrain of this project."""
    drag = drag_blade(blade, WINDOWS[-1][1], _CELL)
    return ResolvedDrag(blade, [drag.mean(*window) for window in WINDOWS])


def record_drags(path: Path, radius: float) -> None:
    """Drag all blades through spheres of a radius [m], and write the forces as a table.

    Raises:
        LiggghtsError: LIGGGHTS is not installed or failed.
    """
    rows = []
    for blade in _BLADES:
        print(f"LIGGGHTS: {blade}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            drag = drag_in_spheres(
                blade, _TOOL_FRICTION[blade.soil], WINDOWS[-1][1], radius, Path(folder)
            )
        for low, high in WINDOWS:
            friction = _TOOL_FRICTION[blade.soil]
            rows.append((blade.width, blade.rake, friction, low, high, *drag.mean(low, high)))
    path.parent.mkdir(parents=True, exist_ok=True)
    names = "width_m,rake_deg,tool_friction_deg,from_m,to_m,draft_n,lift_n"
    np.savetxt(path, rows, delimiter=",", header=names, comments="", fmt="%.5g")


def read_drags(path: Path = RECORDED) -> list[ResolvedDrag]:
    """Return the drags of a table of `record_drags`.

    Raises:
        OSError: the table cannot be read.
        ValueError: it has other drags.
    """
    table = np.genfromtxt(path, delimiter=",", names=True)
    if len(table) != len(_BLADES) * len(WINDOWS):
        raise ValueError(f"{path} has {len(table)} rows; record it again with --resolve")
    forces = list(zip(table["draft_n"].tolist(), table["lift_n"].tolist(), strict=True))
    count = len(WINDOWS)
    return [
        ResolvedDrag(blade, forces[count * k : count * (k + 1)]) for k, blade in enumerate(_BLADES)
    ]

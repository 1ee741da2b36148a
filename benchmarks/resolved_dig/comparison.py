"""Two digs on the same path as numbers, as tables and as a picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.resolved_dig.dig import DigRecord
from earthmoving_sim.pictures.style import CUT, DPI, FILL, add_axes, label_chart, new_figure

__all__ = ["Comparison", "compare", "draw_comparison", "read_tables", "write_tables"]

Array = NDArray[np.float64]

_TABLE, _PROFILE_TABLE = "resolved_dig.csv", "resolved_dig_profile.csv"
"""Files of a folder of tables: over time, and over the positions of the profile."""

_ROUGHNESS = 0.04
"""Change of height that a surface of spheres has without a dig [m]."""


_LEVEL_SLOPE = 0.1
"""Slope of the path of the lip up to which it cuts level."""


class Comparison(NamedTuple):
    """Ratios of the first to the second dig.

    Attributes:
        force: of the mean horizontal force while the bucket cuts.
        vertical: of the mean vertical force while it cuts level.
        work: of the work of the force on the bucket.
        fill: of the volume in the bucket where it leaves the ground.
        trench: of the volume that the profile lost below z = 0, by width.
        berm: of the volume that the profile gained above z = 0, by width.
    """

    force: float
    vertical: float
    work: float
    fill: float
    trench: float
    berm: float


def compare(first: DigRecord, second: DigRecord) -> Comparison:
    """Return the ratios of two digs on the same path."""
    is_cutting, is_level = _is_cutting(first)
    full = np.flatnonzero(is_cutting & ~np.isnan(second.fill))[-1]
    ratios = [
        first.force[is_cutting, 0].mean() / second.force[is_cutting, 0].mean(),
        first.force[is_level, 2].mean() / second.force[is_level, 2].mean(),
        _work(first) / _work(second),
        first.fill[full] / second.fill[full],
    ]
    is_known = ~np.isnan(second.profile)
    for sign in (-1.0, 1.0):
        changes = (sign * each.profile[is_known] for each in (first, second))
        a, b = (change[change > _ROUGHNESS].sum() for change in changes)
        ratios.append(a / b)
    return Comparison(*map(float, ratios))


def write_tables(folder: Path, digs: dict[str, DigRecord]) -> None:
    """Write the path, and forces, fills and profiles of digs by name, as CSV files."""
    folder.mkdir(parents=True, exist_ok=True)
    path = next(iter(digs.values()))
    names, columns = ["time_s", "x_m", "z_m", "pitch_rad"], [path.times]
    columns += [path.origin[:, 0], path.origin[:, 2], path.pitch]
    for name, dig in digs.items():
        names += [f"{name}_fx_n", f"{name}_fz_n", f"{name}_fill_m3"]
        columns += [dig.force[:, 0], dig.force[:, 2], dig.fill]
    _write_csv(folder / _TABLE, names, columns)
    profiles = [dig.profile for dig in digs.values()]
    _write_csv(
        folder / _PROFILE_TABLE,
        ["x_m", *(f"{name}_z_m" for name in digs)],
        [path.x, *profiles],
    )


def read_tables(folder: Path, name: str, path: DigRecord) -> DigRecord:
    """Return a dig by name from the tables of `write_tables`.

    Args:
        folder: folder of the tables.
        name: name of the dig.
        path: a dig on about the same path, with the same times and positions of the profile.

    Raises:
        OSError: a table is missing.
        ValueError: it has no such dig, or other times or positions.
    """
    table, profile = (
        np.genfromtxt(folder / file, delimiter=",", names=True) for file in (_TABLE, _PROFILE_TABLE)
    )
    if not (
        len(table) == len(path.times)
        and np.allclose(table["time_s"], path.times)
        and len(profile) == len(path.x)
        and np.allclose(profile["x_m"], path.x, atol=1e-3)
    ):
        raise ValueError(f"{folder} has a dig with other times or positions; record it again")
    zeros = np.zeros(len(table))
    force = np.column_stack([table[f"{name}_fx_n"], zeros, table[f"{name}_fz_n"]])
    origin = np.column_stack([table["x_m"], zeros, table["z_m"]])
    return replace(
        path,
        origin=origin,
        pitch=table["pitch_rad"],
        force=force,
        fill=table[f"{name}_fill_m3"],
        profile=profile[f"{name}_z_m"],
    )


def draw_comparison(path: Path, digs: dict[str, DigRecord]) -> None:
    """Draw force and fill over time, and the profile of the ground."""
    figure = new_figure(12.6, 4.3)
    force, fill, ground = (add_axes(figure, 0.7 + 4.15 * k, 0.6, 3.4, 3.3) for k in range(3))
    for (name, dig), colour in zip(digs.items(), (CUT, FILL), strict=True):
        force.plot(dig.times, 1e-3 * dig.force[:, 0], color=colour, label=f"{name}, against travel")
        force.plot(
            dig.times, -1e-3 * dig.force[:, 2], color=colour, linestyle=":", label=f"{name}, down"
        )
        known = ~np.isnan(dig.fill)
        fill.plot(dig.times[known], dig.fill[known], color=colour, label=name)
        ground.plot(dig.x, dig.profile, color=colour, label=name)
    ground.set_xlim(3.2, 8.2)
    label_chart(force, "Force on the bucket", "time [s]", "kN")
    label_chart(fill, "Soil below the opening", "time [s]", "m³")
    label_chart(ground, "Ground at the end, mean over 0.6 m", "x [m]", "height [m]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)


def _is_cutting(dig: DigRecord) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return in which intervals the lip is in the ground and moves toward -x, and level besides."""
    reach = dig.bucket.tip_radius
    x = dig.origin[:, 0] + reach * np.cos(dig.pitch)
    z = dig.origin[:, 2] - reach * np.sin(dig.pitch)
    forward, up = -np.diff(x, prepend=x[0]), np.diff(z, prepend=z[0])
    is_cutting = (z < -0.05) & (forward > 1e-3)
    return is_cutting, is_cutting & (np.abs(up) < _LEVEL_SLOPE * forward)


def _work(dig: DigRecord) -> float:
    """Return the work of the bucket pin against the force [J], without that of rotation."""
    steps = np.diff(dig.origin, axis=0)
    return float(-(dig.force[1:] * steps).sum())


def _write_csv(path: Path, names: list[str], columns: list[Array]) -> None:
    table = np.column_stack(columns)
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.5g")

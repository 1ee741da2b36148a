"""A bed of spheres in LIGGGHTS, through which a bucket follows a recorded path.

The bucket moves by short segments: with the velocity of its pin, and about its pin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.liggghts_runner import run_program
from benchmarks.resolved_dig.dig import INTERVAL, DigRecord
from benchmarks.sphere_bed import PACKING, SphereBed, numbers, write_mesh

__all__ = ["RADIUS", "dig_in_liggghts", "write_input"]

Array = NDArray[np.float64]

RADIUS = 0.0255
"""Radius of the spheres [m], of which there are 112,000."""

_LENGTH, _WIDTH, _DEPTH = (3.2, 8.2), (-1.4, 1.4), 0.9
"""Range of the bed in x and in y, and its depth [m]."""

_POURED_HEIGHT = 1.25
"""Height to which spheres are placed before they settle [m]."""

_SETTLING_TIME, _LEVELLING_TIME = 1.25, 0.25
"""Times in which the spheres come to rest, before and after the bed is levelled [s]."""

_DUMPS_EVERY = 5
"""Segments between two records of all spheres."""

_TIME_LIMIT = 4.0 * 3600.0  # [s]


def dig_in_liggghts(record: DigRecord, radius: float, folder: Path) -> DigRecord:
    """Return the dig of a bucket on the path of another one.

    Args:
        record: the path, and the soil.
        radius: of the spheres [m].
        folder: folder for the files of LIGGGHTS.

    Raises:
        LiggghtsError: LIGGGHTS is not installed or failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("dig_*.txt"):
        old.unlink()
    num_steps = write_input(record, radius, folder)
    run_program(folder, _TIME_LIMIT)
    means = np.loadtxt(folder / "force.txt")
    force = np.vstack([np.zeros(3), means[:, 1:4]])  # the path begins at the end of an interval
    first = int(means[0, 0]) - num_steps
    fill = np.full(len(record.times), np.nan)
    for step, position in _dumps(folder):
        if step >= first:
            segment = (step - first) // num_steps
            fill[segment] = _fill(record, radius, segment, position)
    end = np.loadtxt(folder / "end.txt", skiprows=9)
    return replace(record, force=force, fill=fill, profile=_profile(record, radius, end))


def write_input(record: DigRecord, radius: float, folder: Path) -> int:
    """Write the files of a run into a folder; return the number of steps of a segment."""
    bed = _bed(record, radius)
    bed.write_spheres(folder / "data.txt")
    _write_bucket(record, folder / "tool.stl")
    num_steps = bed.steps_in(INTERVAL)
    lines = [*_bed_lines(bed, num_steps), *_motion_lines(record, num_steps)]
    (folder / "in.txt").write_text("\n".join([*lines, ""]))
    return num_steps


def _bed(record: DigRecord, radius: float) -> SphereBed:
    """Return the bed of a dig."""
    return SphereBed(
        _LENGTH, _WIDTH, _DEPTH, _POURED_HEIGHT, record.density, record.tool_friction, radius
    )


def _write_bucket(record: DigRecord, path: Path) -> None:
    """Write the plates of the bucket as triangles at the start of the path."""
    rotation, origin = _pose(record, 0)
    outline, half = record.bucket.profile, 0.5 * record.bucket.width
    left, right = (
        np.column_stack([outline[:, 0], np.full(len(outline), y), outline[:, 1]])
        for y in (half, -half)
    )
    triangles = []
    for k in range(len(outline) - 1):
        triangles += [(left[k], right[k], right[k + 1]), (left[k], right[k + 1], left[k + 1])]
    for side in (left, right):
        triangles += [(side[0], side[k], side[k + 1]) for k in range(1, len(outline) - 1)]
    write_mesh(
        path, [[rotation @ corner + origin for corner in triangle] for triangle in triangles]
    )


def _bed_lines(bed: SphereBed, num_steps: int) -> list[str]:
    """Return the commands that make the bed and the bucket.

    The path begins at a step at which all spheres are recorded.
    """
    every = _DUMPS_EVERY * num_steps
    settling, levelling = (
        every * math.ceil(time / (_DUMPS_EVERY * INTERVAL))
        for time in (_SETTLING_TIME, _LEVELLING_TIME)
    )
    return bed.commands(INTERVAL / num_steps, settling, levelling)


def _motion_lines(record: DigRecord, num_steps: int) -> list[str]:
    """Return the commands that move the bucket along the path, and record."""
    lines = [
        f"fix force all ave/time 1 {num_steps} {num_steps} f_tool[1] f_tool[2] f_tool[3]"
        " file force.txt",
        f"dump all all custom {_DUMPS_EVERY * num_steps} dig_*.txt x y z",
        f"thermo {_DUMPS_EVERY * num_steps}",
    ]
    for k in range(len(record.times) - 1):
        velocity = (record.origin[k + 1] - record.origin[k]) / INTERVAL
        turn = float(record.pitch[k + 1] - record.pitch[k])
        lines.append(f"fix slide all move/mesh mesh tool linear {numbers(velocity)}")
        if abs(turn) > 1e-7:
            lines.append(
                f"fix turn all move/mesh mesh tool rotate origin {numbers(record.origin[k])}"
                f" axis 0. {math.copysign(1.0, turn)} 0."
                f" period {2.0 * math.pi * INTERVAL / abs(turn):.9g}"
            )
        lines.append(f"run {num_steps}")
        lines += ["unfix turn", "unfix slide"] if abs(turn) > 1e-7 else ["unfix slide"]
    return [*lines, "dump end all custom 1 end.txt x y z", "run 0"]


def _dumps(folder: Path) -> Iterator[tuple[int, Array]]:
    """Yield the step and the centres of the spheres [m], shape (n, 3), of each dump, in order."""
    paths = {
        int(found[1]): path
        for path in folder.glob("dig_*.txt")
        if (found := re.fullmatch(r"dig_(\d+)\.txt", path.name))
    }
    for step in sorted(paths):
        yield step, np.loadtxt(paths[step], skiprows=9)


def _fill(record: DigRecord, radius: float, segment: int, position: Array) -> float:
    """Return the bank volume in the bucket at the end of a segment [m^3]."""
    rotation, origin = _pose(record, segment)
    count = record.bucket.contains((position - origin) @ rotation).sum()
    return float(count * 4.0 / 3.0 * math.pi * radius**3 / PACKING)


def _profile(record: DigRecord, radius: float, position: Array) -> Array:
    """Return the height of the ground at the positions of the profile [m]; NaN beyond the bed.

    The bucket, and what is in it or heaped on it, do not count.
    """
    rotation, origin = _pose(record, len(record.times) - 1)
    outline = record.bucket.profile @ rotation[[0, 2]][:, [0, 2]].T + origin[[0, 2]]
    (low, bottom), (high, _) = outline.min(axis=0), outline.max(axis=0)
    is_over_bucket = (position[:, 0] > low) & (position[:, 0] < high) & (position[:, 2] > bottom)
    is_ground = ~is_over_bucket & (np.abs(position[:, 1]) <= 0.3)
    points = position[is_ground & (position[:, 2] < 0.5)]
    half = 0.5 * abs(record.x[1] - record.x[0])
    profile = np.full(len(record.x), np.nan)
    for k, x in enumerate(record.x.tolist()):
        near = points[np.abs(points[:, 0] - x) <= half]
        if _LENGTH[0] < x < _LENGTH[1] and len(near):
            strips = np.floor((near[:, 1] + 0.3) / 0.1).astype(int)
            tops = [near[strips == n, 2].max() for n in np.unique(strips)]
            profile[k] = float(np.mean(tops)) + radius
    return profile


def _pose(record: DigRecord, index: int) -> tuple[Array, Array]:
    """Return rotation and origin of the bucket at the end of a segment."""
    cos, sin = math.cos(record.pitch[index]), math.sin(record.pitch[index])
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]), record.origin[index]

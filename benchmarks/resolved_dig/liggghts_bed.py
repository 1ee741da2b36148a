"""A bed of spheres in LIGGGHTS, through which a bucket follows a recorded path.

The spheres are poured into a box, come to rest, and are levelled so that their bulk volume ends at
z = 0. The bucket is a mesh of its plates, without thickness. It moves by short segments: with the
velocity of its pin, and about its pin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.liggghts_runner import (
    MIN_YOUNGS_MODULUS,
    ContactCoefficients,
    rayleigh_time,
    run_program,
)
from benchmarks.resolved_dig.dig import INTERVAL, DigRecord

__all__ = ["Bed", "dig_in_liggghts", "write_input"]

Array = NDArray[np.float64]

_LENGTH, _WIDTH, _DEPTH = (3.2, 8.2), (-1.4, 1.4), 0.9
"""Range of the bed in x and in y, and its depth [m]."""

_POURED_HEIGHT = 1.25
"""Height to which spheres are placed before they settle [m]."""

_PACKING = 0.60
"""Share of the bed's volume that is in spheres when it is poured; it settles to 0.64."""

_SETTLING_TIME, _LEVELLING_TIME = 1.25, 0.25
"""Times in which the spheres come to rest, before and after the bed is levelled [s]."""

_LEVELLING_HEIGHT = 0.8
"""Height of the centres above which spheres are removed [radii]: the rest settles to z = 0."""

_DUMPS_EVERY = 5
"""Segments between two records of all spheres."""

_TIME_LIMIT = 4.0 * 3600.0  # [s]
_MAX_RAYLEIGH_FRACTION = 0.2
_POISSON_RATIO = 0.3
_MODEL = "model hertz tangential history rolling_friction epsd2"


@dataclass(frozen=True)
class Bed:
    """Spheres of a bed.

    Attributes:
        radius: of all of them [m].
        contact: coefficients of the contact of two of them: with friction 0.5 and rolling friction
            0.2 the sides of the trench come to rest at 32 degrees.
    """

    radius: float = 0.0255
    contact: ContactCoefficients = field(default_factory=lambda: ContactCoefficients(0.5, 0.2, 0.3))


def dig_in_liggghts(record: DigRecord, bed: Bed, folder: Path) -> DigRecord:
    """Return the dig of a bucket on the path of another one.

    Args:
        record: the path, and the soil.
        bed: the spheres.
        folder: folder for the files of LIGGGHTS.

    Raises:
        LiggghtsError: LIGGGHTS is not installed or failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("dig_*.txt"):
        old.unlink()
    num_steps = write_input(record, bed, folder)
    run_program(folder, _TIME_LIMIT)
    means = np.loadtxt(folder / "force.txt")
    force = np.vstack([np.zeros(3), means[:, 1:4]])  # the path begins at the end of an interval
    first = int(means[0, 0]) - num_steps
    fill = np.full(len(record.times), np.nan)
    for step, position in _dumps(folder):
        if step >= first:
            segment = (step - first) // num_steps
            fill[segment] = _fill(record, bed, segment, position)
    end = np.loadtxt(folder / "end.txt", skiprows=9)
    return replace(record, force=force, fill=fill, profile=_profile(record, bed, end))


def write_input(record: DigRecord, bed: Bed, folder: Path) -> int:
    """Write the files of a run into a folder; return the number of steps of a segment."""
    _write_spheres(record, bed, folder / "data.txt")
    _write_mesh(record, folder / "bucket.stl")
    longest = _MAX_RAYLEIGH_FRACTION * rayleigh_time(
        bed.radius, record.density / _PACKING, MIN_YOUNGS_MODULUS
    )
    num_steps = math.ceil(INTERVAL / longest)
    lines = [*_bed_lines(record, bed, num_steps), *_motion_lines(record, num_steps)]
    (folder / "in.txt").write_text("\n".join([*lines, ""]))
    return num_steps


def _write_spheres(record: DigRecord, bed: Bed, path: Path) -> None:
    """Write the spheres of the bed, on a lattice with small random deviations."""
    radius, rng = bed.radius, np.random.default_rng(1)
    spacing = 2.06 * radius
    axes = (
        np.arange(_LENGTH[0] + 1.03 * radius, _LENGTH[1] - radius, spacing),
        np.arange(_WIDTH[0] + 1.03 * radius, _WIDTH[1] - radius, spacing),
        np.arange(1.03 * radius, _POURED_HEIGHT, spacing) - _DEPTH,
    )
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points += rng.uniform(-0.02 * radius, 0.02 * radius, points.shape)
    density = record.density / _PACKING
    rows = [
        f"{k} 1 {2.0 * radius} {density:.9g} {x:.6f} {y:.6f} {z:.6f}"
        for k, (x, y, z) in enumerate(points.tolist(), start=1)
    ]
    box = ((*_LENGTH, "x"), (*_WIDTH, "y"), (-_DEPTH, 3.2, "z"))
    bounds = [f"{low} {high} {axis}lo {axis}hi" for low, high, axis in box]
    head = ["bed", "", f"{len(rows)} atoms", "2 atom types", *bounds, "", "Atoms", ""]
    path.write_text("\n".join([*head, *rows, ""]))


def _write_mesh(record: DigRecord, path: Path) -> None:
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
    lines = ["solid bucket"]
    for triangle in triangles:
        corners = [rotation @ corner + origin for corner in triangle]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        lines.append("facet normal " + _numbers(normal / np.linalg.norm(normal)) + "\nouter loop")
        lines += [f"vertex {_numbers(corner)}" for corner in corners]
        lines.append("endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid bucket", ""]))


def _bed_lines(record: DigRecord, bed: Bed, num_steps: int) -> list[str]:
    """Return the commands that make the bed and the bucket.

    The path begins at a step at which all spheres are recorded.
    """
    every = _DUMPS_EVERY * num_steps
    settling, levelling = (
        every * math.ceil(time / (_DUMPS_EVERY * INTERVAL))
        for time in (_SETTLING_TIME, _LEVELLING_TIME)
    )
    modulus, poisson = f"{MIN_YOUNGS_MODULUS:.9g}", _POISSON_RATIO
    wall = math.tan(math.radians(record.tool_friction))

    def pairs(value: float, at_wall: float) -> str:
        # Type 1 is the spheres, type 2 the bucket and the sides of the box.
        return f"peratomtypepair 2 {value:.9g} {at_wall:.9g} {at_wall:.9g} {at_wall:.9g}"

    friction, rolling = bed.contact.friction, bed.contact.rolling_friction
    restitution = bed.contact.restitution
    sides = [
        f"fix {axis}{k} all wall/gran {_MODEL} primitive type 2 {axis}plane {value}"
        for axis, limits in (("x", _LENGTH), ("y", _WIDTH))
        for k, value in enumerate(limits)
    ]
    return [
        "atom_style granular",
        "atom_modify map array",
        "boundary f f f",
        "newton off",
        "communicate single vel yes",
        "units si",
        "read_data data.txt",
        f"neighbor {0.5 * bed.radius:.9g} bin",
        "neigh_modify delay 0",
        f"fix young all property/global youngsModulus peratomtype {modulus} {modulus}",
        f"fix poisson all property/global poissonsRatio peratomtype {poisson} {poisson}",
        "fix rebound all property/global coefficientRestitution " + pairs(restitution, restitution),
        "fix coulomb all property/global coefficientFriction " + pairs(friction, wall),
        "fix rolling all property/global coefficientRollingFriction " + pairs(rolling, rolling),
        f"pair_style gran {_MODEL}",
        "pair_coeff * *",
        f"timestep {INTERVAL / num_steps:.9g}",
        "fix weight all gravity 9.81 vector 0.0 0.0 -1.0",
        f"fix floor all wall/gran {_MODEL} primitive type 1 zplane {-_DEPTH}",
        *sides,
        "fix motion all nve/sphere",
        "thermo_style custom step atoms ke",
        "thermo 500",
        f"run {settling}",
        f"region above block INF INF INF INF {_LEVELLING_HEIGHT * bed.radius:.9g} INF units box",
        "delete_atoms region above compress no",
        f"run {levelling}",
        "fix bucket all mesh/surface/stress file bucket.stl type 2",
        f"fix plates all wall/gran {_MODEL} mesh n_meshes 1 meshes bucket",
    ]


def _motion_lines(record: DigRecord, num_steps: int) -> list[str]:
    """Return the commands that move the bucket along the path, and record."""
    lines = [
        f"fix force all ave/time 1 {num_steps} {num_steps} f_bucket[1] f_bucket[2] f_bucket[3]"
        " file force.txt",
        f"dump all all custom {_DUMPS_EVERY * num_steps} dig_*.txt x y z",
        f"thermo {_DUMPS_EVERY * num_steps}",
    ]
    for k in range(len(record.times) - 1):
        velocity = (record.origin[k + 1] - record.origin[k]) / INTERVAL
        turn = float(record.pitch[k + 1] - record.pitch[k])
        lines.append(f"fix slide all move/mesh mesh bucket linear {_numbers(velocity)}")
        if abs(turn) > 1e-7:
            lines.append(
                f"fix turn all move/mesh mesh bucket rotate origin {_numbers(record.origin[k])}"
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


def _fill(record: DigRecord, bed: Bed, segment: int, position: Array) -> float:
    """Return the bank volume in the bucket at the end of a segment [m^3]."""
    rotation, origin = _pose(record, segment)
    count = record.bucket.contains((position - origin) @ rotation).sum()
    return float(count * 4.0 / 3.0 * math.pi * bed.radius**3 / _PACKING)


def _profile(record: DigRecord, bed: Bed, position: Array) -> Array:
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
            profile[k] = float(np.mean(tops)) + bed.radius
    return profile


def _pose(record: DigRecord, index: int) -> tuple[Array, Array]:
    """Return rotation and origin of the bucket at the end of a segment."""
    cos, sin = math.cos(record.pitch[index]), math.sin(record.pitch[index])
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]), record.origin[index]


def _numbers(vector: Array) -> str:
    return " ".join(f"{value:.9g}" for value in vector.tolist())

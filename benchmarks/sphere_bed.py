"""A bed of spheres in LIGGGHTS, level at z = 0, through which a tool of plates can move.

The spheres are poured into a box, come to rest, and are levelled so that their bulk volume ends at
z = 0. The tool is a mesh of plates without thickness.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.liggghts_runner import MIN_YOUNGS_MODULUS, ContactCoefficients, rayleigh_time

__all__ = ["PACKING", "SphereBed", "numbers", "write_mesh"]

Array = NDArray[np.float64]

PACKING = 0.60
"""Share of the bed's volume that is in spheres."""

_SPACING = 2.06
"""Distance of the spheres before they settle [radii]."""

_LEVELLING_HEIGHT = 0.8
"""Height of the centres above which spheres are removed [radii]: the rest settles to z = 0."""

_MAX_RAYLEIGH_FRACTION = 0.2
_POISSON_RATIO = 0.3
_MODEL = "model hertz tangential history rolling_friction epsd2"


@dataclass(frozen=True)
class SphereBed:
    """Spheres of one size in a box.

    Attributes:
        x, y: range of the box [m].
        depth: depth of the bed [m].
        poured_height: height to which spheres are placed before they settle [m].
        bulk_density: density of the bed at `PACKING` [kg/m^3].
        tool_friction: angle of friction on the tool and on the sides of the box [deg].
        radius: of the spheres [m].
        is_periodic: whether the bed continues at its sides in y, without walls.
        contact: coefficients of the contact of two of them: with friction 0.5 and rolling friction
            0.2 the sides of a trench come to rest at 32 degrees.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    depth: float
    poured_height: float
    bulk_density: float
    tool_friction: float
    radius: float
    is_periodic: bool = False
    contact: ContactCoefficients = field(default_factory=lambda: ContactCoefficients(0.5, 0.2, 0.3))

    def steps_in(self, interval: float) -> int:
        """Return the smallest number of time steps in an interval [s] that are short enough."""
        density = self.bulk_density / PACKING
        longest = _MAX_RAYLEIGH_FRACTION * rayleigh_time(self.radius, density, MIN_YOUNGS_MODULUS)
        return math.ceil(interval / longest)

    def write_spheres(self, path: Path) -> None:
        """Write the spheres, on a lattice with small random deviations, as `data.txt` of a run."""
        radius, rng = self.radius, np.random.default_rng(1)
        spacing, margin = _SPACING * radius, 0.5 * _SPACING * radius
        ends = (self.x, self.y)
        axes = (
            *(np.arange(low + margin, high - radius, spacing) for low, high in ends),
            np.arange(margin, self.poured_height, spacing) - self.depth,
        )
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        points += rng.uniform(-0.02 * radius, 0.02 * radius, points.shape)
        density = self.bulk_density / PACKING
        rows = [
            f"{k} 1 {2.0 * radius} {density:.9g} {x:.6f} {y:.6f} {z:.6f}"
            for k, (x, y, z) in enumerate(points.tolist(), start=1)
        ]
        box = ((*self.x, "x"), (*self.y, "y"), (-self.depth, 3.2, "z"))
        bounds = [f"{low} {high} {axis}lo {axis}hi" for low, high, axis in box]
        head = ["bed", "", f"{len(rows)} atoms", "2 atom types", *bounds, "", "Atoms", ""]
        path.write_text("\n".join([*head, *rows, ""]))

    def commands(self, timestep: float, settling: int, levelling: int) -> list[str]:
        """Return the commands that make the bed from `data.txt`, and the tool from `tool.stl`.

        The force on the mesh `tool` is f_tool[1] to f_tool[3].

        Args:
            timestep: [s].
            settling, levelling: steps before and after the bed is levelled.
        """
        modulus, poisson = f"{MIN_YOUNGS_MODULUS:.9g}", _POISSON_RATIO
        wall = math.tan(math.radians(self.tool_friction))

        def pairs(value: float, at_wall: float) -> str:
            # Type 1 is the spheres, type 2 the tool and the sides of the box.
            return f"peratomtypepair 2 {value:.9g} {at_wall:.9g} {at_wall:.9g} {at_wall:.9g}"

        friction, rolling = self.contact.friction, self.contact.rolling_friction
        restitution = self.contact.restitution
        walls = [("x", self.x)] if self.is_periodic else [("x", self.x), ("y", self.y)]
        sides = [
            f"fix {axis}{k} all wall/gran {_MODEL} primitive type 2 {axis}plane {value}"
            for axis, limits in walls
            for k, value in enumerate(limits)
        ]
        return [
            "atom_style granular",
            "atom_modify map array",
            f"boundary f {'p' if self.is_periodic else 'f'} f",
            "newton off",
            "communicate single vel yes",
            "units si",
            "read_data data.txt",
            f"neighbor {0.5 * self.radius:.9g} bin",
            "neigh_modify delay 0",
            f"fix young all property/global youngsModulus peratomtype {modulus} {modulus}",
            f"fix poisson all property/global poissonsRatio peratomtype {poisson} {poisson}",
            "fix rebound all property/global coefficientRestitution "
            + pairs(restitution, restitution),
            "fix coulomb all property/global coefficientFriction " + pairs(friction, wall),
            "fix rolling all property/global coefficientRollingFriction " + pairs(rolling, rolling),
            f"pair_style gran {_MODEL}",
            "pair_coeff * *",
            f"timestep {timestep:.9g}",
            "fix weight all gravity 9.81 vector 0.0 0.0 -1.0",
            f"fix floor all wall/gran {_MODEL} primitive type 1 zplane {-self.depth}",
            *sides,
            "fix motion all nve/sphere",
            "thermo_style custom step atoms ke",
            "thermo 500",
            f"run {settling}",
            f"region above block INF INF INF INF {_LEVELLING_HEIGHT * self.radius:.9g} INF"
            " units box",
            "delete_atoms region above compress no",
            f"run {levelling}",
            "fix tool all mesh/surface/stress file tool.stl type 2",
            f"fix plates all wall/gran {_MODEL} mesh n_meshes 1 meshes tool",
        ]


def write_mesh(path: Path, triangles: Sequence[Sequence[Array]]) -> None:
    """Write triangles, three corners [m] each, as a mesh."""
    lines = ["solid tool"]
    for corners in triangles:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        lines.append("facet normal " + numbers(normal / np.linalg.norm(normal)) + "\nouter loop")
        lines += [f"vertex {numbers(corner)}" for corner in corners]
        lines.append("endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid tool", ""]))


def numbers(vector: Array) -> str:
    """Return the components of a vector for a command."""
    return " ".join(f"{value:.9g}" for value in vector.tolist())

"""Kinds of visual shapes that a shapes file can name, each with its mesh."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, cast

import numpy as np

from machine_sim.machine.errors import MachineError
from machine_sim.machine.shapes.solids import Axis, box, cylinder, extrusion, tube
from machine_sim.machine.shapes.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from machine_sim.machine.spec_file.section import Section

__all__ = [
    "SHAPE_KINDS",
    "BoxShape",
    "CylinderShape",
    "PlacedShape",
    "ProfileShape",
    "Shape",
    "TubeShape",
    "rotation_from_rpy",
]

Vec3 = tuple[float, float, float]
Corners = tuple[tuple[float, ...], ...]

_AXIS_NAMES = ("x", "y", "z")
_ORIGIN = (0.0, 0.0, 0.0)


class Shape(Protocol):
    """A body in the frame of its link."""

    kind: ClassVar[str]

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the shape from an entry of a shapes file.

        Raises:
            MachineError: a missing key or a value out of range.
        """
        ...

    def mesh(self) -> TriangleMesh:
        """Return the closed surface.

        Raises:
            MachineError: an outline that is too narrow for its bevel.
        """
        ...


@dataclass(frozen=True)
class BoxShape:
    """A box with rounded edges.

    Attributes:
        size: edge lengths [m].
        center: position of its centre [m].
        rpy: rotations about the fixed axes x, y, z, in this order, as in URDF [rad].
        radius: radius of the edges [m].
    """

    kind: ClassVar[str] = "box"

    size: Vec3
    center: Vec3
    rpy: Vec3
    radius: float

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the box; see `Shape.from_section`."""
        return cls(
            size=section.vec3("size", positive=True),
            center=section.vec3("center"),
            rpy=section.vec3("rpy") if section.has("rpy") else _ORIGIN,
            radius=_optional(section, "radius", 0.0),
        )

    def mesh(self) -> TriangleMesh:
        """Return the closed surface."""
        return box(self.size, self.radius).moved(rotation_from_rpy(self.rpy), self.center)


@dataclass(frozen=True)
class ProfileShape:
    """An outline extruded along an axis.

    Attributes:
        points: corners of the outline in the two other axes, in the order x, y, z [m], each with an
            optional radius [m].
        width: length along the axis [m].
        axis: axis of the extrusion.
        position: position of its middle along the axis [m].
        bevel: width of the bevels of both ends [m].
        holes: corners of openings, as `points`.
    """

    kind: ClassVar[str] = "profile"

    points: Corners
    width: float
    axis: Axis
    position: float
    bevel: float
    holes: tuple[Corners, ...]

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the profile; see `Shape.from_section`."""
        width = section.number("width", positive=True)
        bevel = _optional(section, "bevel", 0.0)
        if 2.0 * bevel >= width:
            raise MachineError(
                f"{section.key_path('bevel')} is {bevel:g}; give less than half of the width"
                f" {width:g}"
            )
        return cls(
            points=section.corners("points"),
            width=width,
            axis=_axis(section),
            position=section.number("position") if section.has("position") else 0.0,
            bevel=bevel,
            holes=section.corner_lists("holes") if section.has("holes") else (),
        )

    def mesh(self) -> TriangleMesh:
        """Return the closed surface; see `Shape.mesh`."""
        return extrusion(
            self.points,
            self.width,
            axis=self.axis,
            position=self.position,
            bevel=self.bevel,
            holes=self.holes,
        )


@dataclass(frozen=True)
class CylinderShape:
    """A cylinder, cone or ring.

    Attributes:
        radius: radius [m], of a cone that at its end of negative coordinates.
        length: length along the axis [m].
        center: position of its centre [m].
        axis: its axis.
        end_radius: radius at the end of positive coordinates [m].
        bore: radius of a hole along the axis [m].
        bevel: width of the bevels of both ends [m].
        sides: number of flats.
    """

    kind: ClassVar[str] = "cylinder"

    radius: float
    length: float
    center: Vec3
    axis: Axis
    end_radius: float
    bore: float
    bevel: float
    sides: int

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the cylinder; see `Shape.from_section`."""
        radius = section.number("radius", positive=True)
        shape = cls(
            radius=radius,
            length=section.number("length", positive=True),
            center=section.vec3("center"),
            axis=_axis(section),
            end_radius=_optional(section, "end_radius", radius),
            bore=_optional(section, "bore", 0.0),
            bevel=_optional(section, "bevel", 0.0),
            sides=section.count("sides", low=3) if section.has("sides") else 16,
        )
        smallest = min(shape.radius, shape.end_radius) - shape.bevel
        if smallest <= shape.bore:
            raise MachineError(
                f"{section.key_path('bore')} is {shape.bore:g}; give less than the radius without"
                f" its bevel, {smallest:g}"
            )
        return shape

    def mesh(self) -> TriangleMesh:
        """Return the closed surface."""
        body = cylinder(
            self.radius,
            self.length,
            axis=self.axis,
            bevel=self.bevel,
            end_radius=self.end_radius,
            bore=self.bore,
            sides=self.sides,
        )
        return body.moved(np.eye(3), self.center)


@dataclass(frozen=True)
class TubeShape:
    """A round bar, hose or rail along a polyline.

    Attributes:
        points: middle line [m].
        radius: radius of the bar [m].
        end_radius: radius at the last point [m].
        bend: radius of the middle line at its inner points [m].
        sides: number of flats.
    """

    kind: ClassVar[str] = "tube"

    points: tuple[tuple[float, ...], ...]
    radius: float
    end_radius: float
    bend: float
    sides: int

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the tube; see `Shape.from_section`."""
        points = section.vectors("points", None, 3)
        if len(points) < 2 or any(a == b for a, b in pairwise(points)):
            raise MachineError(
                f"{section.key_path('points')} has {len(points)} points; give two or more, each"
                " different from the one before"
            )
        radius = section.number("radius", positive=True)
        return cls(
            points=points,
            radius=radius,
            end_radius=_optional(section, "end_radius", radius),
            bend=_optional(section, "bend", 0.0),
            sides=section.count("sides", low=3) if section.has("sides") else 6,
        )

    def mesh(self) -> TriangleMesh:
        """Return the closed surface."""
        return tube(
            self.points, self.radius, bend=self.bend, sides=self.sides, end_radius=self.end_radius
        )


SHAPE_KINDS: dict[str, type[Shape]] = {
    shape.kind: shape for shape in (BoxShape, ProfileShape, CylinderShape, TubeShape)
}
"""Kinds of shapes by their name in shapes files."""


@dataclass(frozen=True)
class PlacedShape:
    """A shape with its material and its copies.

    Attributes:
        shape: the shape.
        material: name of its material.
        mirror: whether to add a copy reflected in the plane y = 0.
        count: number of copies in a row.
        step: distance from each copy to the next [m].
    """

    shape: Shape
    material: str
    mirror: bool
    count: int
    step: Vec3

    def meshes(self) -> list[TriangleMesh]:
        """Return the mesh of each copy."""
        first = self.shape.mesh()
        row = [
            first.moved(np.eye(3), np.multiply(number, self.step)) for number in range(self.count)
        ]
        return [*row, *(mesh.mirrored() for mesh in row)] if self.mirror else row


def rotation_from_rpy(rpy: Vec3) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the rotation matrix (3, 3) of roll, pitch and yaw about fixed axes [rad]."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _optional(section: Section, key: str, default: float) -> float:
    return section.number(key, low=0.0) if section.has(key) else default


def _axis(section: Section) -> Axis:
    axis = section.text("axis") if section.has("axis") else "y"
    if axis not in _AXIS_NAMES:
        raise MachineError(f"{section.key_path('axis')} is {axis!r}; give x, y or z")
    return cast("Axis", axis)

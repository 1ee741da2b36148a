"""Tool shapes: the protocols they implement, and the registry of kinds that machine files name.

A new kind of tool is a shape here and its interaction with soil in `machine_sim.tool_soil.tools`,
each registered under the same `kind`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.blade import BladeShape
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape
from msg_bridge.kernels import BoxedTable

if TYPE_CHECKING:
    from machine_sim.machine.box import Box
    from machine_sim.machine.spec_file.section import Section

__all__ = [
    "TOOL_SHAPES",
    "ContainerShape",
    "CuttingShape",
    "PlateCuttingShape",
    "ToolMount",
    "ToolShape",
]

Array = NDArray[np.float64]


class ToolShape(Protocol):
    """Shape of a tool in the frame of the link that carries it.

    Attributes:
        kind: name of the kind in machine files.
        spins: whether its joint turns it continuously about y of its link.
        can_carry_soil: whether soil in it counts as payload.
    """

    kind: ClassVar[str]
    spins: ClassVar[bool]
    can_carry_soil: ClassVar[bool]

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the shape from a tool's section of a machine file.

        Raises:
            MachineError: a missing key or a value out of range.
        """
        ...

    def plates(self) -> list[Array]:
        """Return the surfaces that touch soil as convex planar polygons [m], shape (n, 3) each."""
        ...

    def boxes(self) -> list[Box]:
        """Return the visual and rigid-contact boxes."""
        ...


class CuttingShape(ToolShape, Protocol):
    """Shape of a tool that excavates."""

    @property
    def key_points(self) -> Array:
        """Points of the cutting contour [m], shape (2 * pairs, 3): row 2k left, 2k + 1 right."""
        ...

    def release_points(self, points: ArrayLike, clearance: float, up: Array) -> Array:
        """Return the points at which excavated soil becomes particles [m], shape (n, 3).

        Args:
            points: where the soil was cut [m], tool frame (non-spinning), shape (n, 3).
            clearance: minimum distance from the tool's plates [m].
            up: unit vector opposite to gravity, same frame.
        """
        ...


class PlateCuttingShape(CuttingShape, Protocol):
    """Shape of a tool that cuts with its edge and compacts soil with the back of its plates."""

    @property
    def outward_normals(self) -> Array:
        """Unit normals of the back of the plates at each pair of key points, shape (pairs, 3)."""
        ...


class ContainerShape(ToolShape, Protocol):
    """Shape of a tool that carries soil."""

    @property
    def heaped_capacity(self) -> float:
        """Struck volume and heap [m^3]."""
        ...

    @property
    def boxed(self) -> BoxedTable:
        """`open_container.ContainerTable`, boxed, for kernels."""
        ...


TOOL_SHAPES: dict[str, type[ToolShape]] = {
    shape.kind: shape for shape in (BucketShape, BladeShape, DrumShape, BedShape)
}
"""Shape of each kind of tool, by its name in machine files."""


class ToolMount(NamedTuple):
    """A tool and the link that it is fixed to; the tool frame is the link frame."""

    link: str
    shape: ToolShape

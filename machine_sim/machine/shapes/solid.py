"""A closed body with its material."""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.machine.shapes.triangle_mesh import TriangleMesh

__all__ = ["Solid"]


class Solid(NamedTuple):
    """A closed body in the frame of its link.

    Attributes:
        material: name of its material.
        mesh: its surface.
    """

    material: str
    mesh: TriangleMesh

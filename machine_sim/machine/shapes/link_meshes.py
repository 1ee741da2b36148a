"""The mesh of each link of a machine, in groups of one material."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple

from machine_sim.machine.cylinder_visuals import cylinder_parts
from machine_sim.machine.errors import MachineError
from machine_sim.machine.shapes.cylinder_solids import cylinder_solids
from machine_sim.machine.shapes.materials import MATERIALS, Material
from machine_sim.machine.shapes.shape import PlacedShape
from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.tool_solids import box_solid, tool_solids
from machine_sim.machine.shapes.track_solids import (
    idler_solids,
    shoe_solids,
    sprocket_solids,
    track_frame_solids,
)
from machine_sim.machine.shapes.triangle_mesh import ShadedMesh, merge_shaded, shade
from machine_sim.machine.spec import BASE, MachineSpec
from machine_sim.machine.track_wheels import track_wheels

__all__ = ["MaterialGroup", "link_meshes", "link_solids", "num_triangles", "shoe_mesh"]


class MaterialGroup(NamedTuple):
    """The part of a link's mesh that has one material.

    Attributes:
        name: name of the material.
        material: the material.
        mesh: triangles in the frame of the link.
    """

    name: str
    material: Material
    mesh: ShadedMesh


LinkMesh = tuple[MaterialGroup, ...]


@lru_cache(maxsize=16)
def link_meshes(spec: MachineSpec) -> Mapping[str, LinkMesh]:
    """Return the mesh of each link, cylinder part and track wheel by its frame name.

    Raises:
        MachineError: a shape that cannot be built; the message names link and shape.
    """
    meshes = {}
    for name, link in spec.links.items():
        has_shapes = name in spec.shapes.links
        paint = _paint(spec) if has_shapes else Material(link.color)
        frame = "base_link" if name == BASE else name
        meshes[frame] = _grouped(link_solids(spec, name), spec, paint)
    paint = _paint(spec)
    for part in cylinder_parts(spec):
        solids = cylinder_solids(part, spec.cylinders[part.cylinder])
        meshes[part.link] = _grouped(solids, spec, paint)
    for wheel in track_wheels(spec):
        wheel_solids = sprocket_solids if wheel.is_sprocket else idler_solids
        solids = wheel_solids(spec.tracks, math.copysign(1.0, wheel.origin[1]))
        meshes[wheel.link] = _grouped(solids, spec, paint)
    return meshes


@lru_cache(maxsize=16)
def shoe_mesh(spec: MachineSpec) -> LinkMesh:
    """Return the mesh of a track shoe in the frame of `Tracks.shoe_poses`."""
    return _grouped(shoe_solids(spec.tracks), spec, _paint(spec))


def link_solids(spec: MachineSpec, link: str) -> list[Solid]:
    """Return the bodies of a link in its frame: shapes or boxes, tools, and track frames.

    Raises:
        MachineError: a shape that cannot be built.
    """
    shapes = spec.shapes.links.get(link)
    if shapes is None:
        solids = [box_solid(each, "paint") for each in spec.links[link].boxes]
    else:
        solids = [
            solid
            for number, placed in enumerate(shapes)
            for solid in _placed_solids(placed, f"links.{link}[{number}]")
        ]
        if link == BASE:
            solids += track_frame_solids(spec.tracks)
    return [*solids, *tool_solids(spec, link)]


def num_triangles(meshes: Iterable[LinkMesh]) -> int:
    """Return the number of triangles of several meshes."""
    return sum(len(group.mesh.triangles) for mesh in meshes for group in mesh)


def _placed_solids(placed: PlacedShape, path: str) -> list[Solid]:
    try:
        return [Solid(placed.material, mesh) for mesh in placed.meshes()]
    except MachineError as error:
        raise MachineError(f"shapes: {path}: {error}") from error


def _paint(spec: MachineSpec) -> Material:
    """Return the machine's own paint; without one that of the main body's colour."""
    own = spec.shapes.materials.get("paint")
    return own or Material(spec.links[spec.main_body].color, roughness=0.4)


def _grouped(solids: list[Solid], spec: MachineSpec, paint: Material) -> LinkMesh:
    """Return bodies as groups in the order of their first use."""
    materials = {**MATERIALS, **spec.shapes.materials, "paint": paint}
    return tuple(
        MaterialGroup(
            name,
            materials[name],
            merge_shaded(shade(solid.mesh) for solid in solids if solid.material == name),
        )
        for name in dict.fromkeys(solid.material for solid in solids)
    )

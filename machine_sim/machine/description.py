"""URDF of `<m>/robot_description`: the machine as it is shown, with its meshes inside.

Besides the links of the physics it has links for the parts of cylinders, sprockets, idlers and
points of view. The element `<earthmoving>` has what URDF cannot say: the tracks' belts, the engine
and the relief pressures.
"""

from __future__ import annotations

from typing import Literal

from machine_sim.machine.cylinder_visuals import CylinderPart, cylinder_parts
from machine_sim.machine.shapes.glb import glb_data_uri
from machine_sim.machine.shapes.link_meshes import LinkMesh, link_meshes, shoe_mesh
from machine_sim.machine.shapes.machine_shapes import ViewPoint
from machine_sim.machine.spec import BASE, Box, LinkSpec, MachineSpec
from machine_sim.machine.track_wheels import TrackWheel, track_wheels
from machine_sim.machine.urdf import (
    collision_boxes,
    inertial_line,
    joint_lines,
    link_frame,
    numbers,
    shape_text,
    virtual_base_lines,
)
from machine_sim.machine.visuals import shoe_visual

__all__ = ["DescriptionMeshes", "description_text"]

DescriptionMeshes = Literal["embedded", "primitives"]

_WHEEL_COLOR = (0.24, 0.24, 0.25, 1.0)
_WHEEL_WIDTH = 0.2
"""Width of a sprocket or idler drawn as a cylinder [m]."""


def description_text(
    spec: MachineSpec, *, prefix: str = "", meshes: DescriptionMeshes = "embedded"
) -> str:
    """Return the URDF with the joints from `map` to the base, so that joint states place all links.

    Args:
        spec: specification of the machine.
        prefix: prefix of each link name.
        meshes: "embedded": each link has one mesh, a binary glTF as data URI; "primitives": boxes
            and cylinders, for programs that cannot read data URIs, such as RViz.

    Raises:
        MachineError: a shape that cannot be built.
    """
    found = link_meshes(spec) if meshes == "embedded" else {}
    lines = ['<?xml version="1.0"?>', f'<robot name="{spec.name}">', *virtual_base_lines(prefix)]
    for name, link in spec.links.items():
        lines += _link(spec, name, link, prefix, found.get(link_frame(name)))
    lines += joint_lines(spec, prefix)
    for part in cylinder_parts(spec):
        lines += _cylinder_part(part, prefix, found.get(part.link))
    for wheel in track_wheels(spec):
        lines += _wheel(wheel, spec.tracks.sprocket_radius, prefix, found.get(wheel.link))
    for view in spec.shapes.view_points:
        lines += _view_point(view, prefix)
    lines += _extension(spec, prefix, has_meshes=bool(found))
    return "\n".join([*lines, "</robot>", ""])


def _link(
    spec: MachineSpec, name: str, link: LinkSpec, prefix: str, mesh: LinkMesh | None
) -> list[str]:
    frame = link_frame(name, prefix)
    boxes = collision_boxes(spec, name)
    material = _material(frame, (*link.color, 1.0))
    visuals = [f"  <visual>{shape_text(box)}{material}</visual>" for box in boxes]
    if mesh:
        visuals = [_mesh_visual(mesh, material)]
    return [
        f'<link name="{frame}">',
        inertial_line(link),
        *visuals,
        *(f"  <collision>{shape_text(box)}</collision>" for box in boxes),
        "</link>",
    ]


def _cylinder_part(part: CylinderPart, prefix: str, mesh: LinkMesh | None) -> list[str]:
    frame = f"{prefix}{part.link}"
    material = _material(frame, part.color)
    visual = _mesh_visual(mesh, material) if mesh else _box_visual(part.box, material)
    kind, axis = ("prismatic", "1 0 0") if part.is_prismatic else ("continuous", "0 1 0")
    bounds = f'lower="{part.lower!r}" upper="{part.upper!r}" ' if part.is_prismatic else ""
    mimic = f'<mimic joint="{part.mimic}"/>' if part.mimic else ""
    return [
        f'<link name="{frame}">',
        visual,
        "</link>",
        f'<joint name="{part.joint}" type="{kind}">',
        f'  <parent link="{prefix}{part.parent}"/><child link="{frame}"/>',
        f'  <origin xyz="{numbers(part.origin)}"/><axis xyz="{axis}"/>',
        f'  <limit {bounds}effort="0" velocity="1e3"/>{mimic}',
        "</joint>",
    ]


def _wheel(wheel: TrackWheel, radius: float, prefix: str, mesh: LinkMesh | None) -> list[str]:
    frame = f"{prefix}{wheel.link}"
    material = _material(frame, _WHEEL_COLOR)
    disc = (
        '  <visual><origin xyz="0 0 0" rpy="1.5707963267948966 0 0"/><geometry>'
        f'<cylinder radius="{0.85 * radius!r}" length="{_WHEEL_WIDTH!r}"/></geometry>'
        f"{material}</visual>"
    )
    mimic = f'<mimic joint="{wheel.mimic}"/>' if wheel.mimic else ""
    return [
        f'<link name="{frame}">',
        _mesh_visual(mesh, material) if mesh else disc,
        "</link>",
        f'<joint name="{wheel.joint}" type="continuous">',
        f'  <parent link="{link_frame(BASE, prefix)}"/><child link="{frame}"/>',
        f'  <origin xyz="{numbers(wheel.origin)}"/><axis xyz="0 1 0"/>',
        f'  <limit effort="0" velocity="1e3"/>{mimic}',
        "</joint>",
    ]


def _view_point(view: ViewPoint, prefix: str) -> list[str]:
    frame, parent = f"{prefix}{view.name}", link_frame(view.link, prefix)
    return [
        f'<link name="{frame}"/>',
        f'<joint name="{view.name}_mount" type="fixed">',
        f'  <parent link="{parent}"/><child link="{frame}"/>',
        f'  <origin xyz="{numbers(view.position)}" rpy="{numbers(view.rpy)}"/>',
        "</joint>",
    ]


def _extension(spec: MachineSpec, prefix: str, *, has_meshes: bool) -> list[str]:
    """Return the element of facts that URDF has no element for."""
    tracks = spec.tracks
    shoe = shoe_visual(spec)
    lines = ["<earthmoving>"]
    for wheel in track_wheels(spec):
        if not wheel.is_sprocket:
            continue
        lines.append(
            f'  <track joint="{wheel.joint}" link="{link_frame(BASE, prefix)}"'
            f' y="{wheel.origin[1]!r}" axle_distance="{tracks.axle_distance!r}"'
            f' axle_height="{tracks.axle_height!r}" radius="{tracks.sprocket_radius!r}"'
            f' shoe_count="{tracks.shoe_count}" shoe_size="{numbers(shoe.shoe_size)}"'
            f' color="{numbers(shoe.color)}"/>'
        )
    if has_meshes:
        lines.append(f'  <shoe><mesh filename="{glb_data_uri(shoe_mesh(spec))}"/></shoe>')
    if spec.supply is not None:
        supply = spec.supply
        lines += [
            f'  <engine rated_power="{supply.engine_power!r}"/>',
            f'  <hydraulics main_relief_pressure="{supply.main_relief_pressure!r}"'
            f' port_relief_pressure="{supply.port_relief_pressure!r}"/>',
        ]
    return [*lines, "</earthmoving>"]


def _mesh_visual(mesh: LinkMesh, material: str) -> str:
    # The material is for programs that ignore those of the mesh.
    return (
        f'  <visual><geometry><mesh filename="{glb_data_uri(mesh)}"/></geometry>{material}</visual>'
    )


def _box_visual(box: Box, material: str) -> str:
    return f"  <visual>{shape_text(box)}{material}</visual>"


def _material(frame: str, color: tuple[float, ...]) -> str:
    return f'<material name="{frame}_paint"><color rgba="{numbers(color)}"/></material>'

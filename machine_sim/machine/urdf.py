"""URDF text of a machine with primitive shapes, for the physics and for robot_state_publisher."""

from __future__ import annotations

import math
from collections.abc import Sequence

from machine_sim.machine.cylinder_visuals import CylinderPart, cylinder_parts
from machine_sim.machine.spec import BASE, Box, LinkSpec, MachineSpec

__all__ = ["BASE_JOINTS", "urdf_text"]

BASE_JOINTS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
"""Joints from `map` to the base in a URDF that has the base's pose as joint values."""

_VIRTUAL_AXES = (
    ("prismatic", "1 0 0"),
    ("prismatic", "0 1 0"),
    ("prismatic", "0 0 1"),
    ("continuous", "0 0 1"),
    ("continuous", "0 1 0"),
    ("continuous", "1 0 0"),
)
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def urdf_text(
    spec: MachineSpec,
    *,
    prefix: str = "",
    virtual_base: bool = False,
    include_cylinders: bool = False,
) -> str:
    """Return the URDF of a machine; the base is `base_link`, the other links keep their names.

    Args:
        spec: specification of the machine.
        prefix: prefix of each link name, so that several machines can share one TF tree.
        virtual_base: add the joints `BASE_JOINTS` from the link `map` to the base, so that joint
            states alone give the pose of the machine; not for the physics engine.
        include_cylinders: add the parts of the cylinders, which are only visual; see
            `cylinder_visuals`.
    """
    links = spec.links
    frames = {name: f"{prefix}{'base_link' if name == BASE else name}" for name in links}
    lines = ['<?xml version="1.0"?>', f'<robot name="{spec.name}">']
    if virtual_base:
        lines += _virtual_base(frames["base"], prefix)
    for name, link in links.items():
        tools = [tool.shape for tool in spec.tools.values() if tool.link == name]
        boxes = [*link.boxes, *(box for shape in tools for box in shape.boxes())]
        lines += _link(frames[name], link, boxes)
    for name, joint in spec.joints.items():
        bounds = ""
        if math.isfinite(joint.lower):
            bounds = f'lower="{joint.lower!r}" upper="{joint.upper!r}" '
        lines += [
            f'<joint name="{name}" type="{"revolute" if bounds else "continuous"}">',
            f'  <parent link="{frames[joint.parent]}"/><child link="{frames[joint.child]}"/>',
            f'  <origin xyz="{_numbers(joint.origin)}"/><axis xyz="{_AXES[joint.axis]}"/>',
            f'  <limit {bounds}effort="{joint.max_effort!r}" velocity="{joint.max_velocity!r}"/>',
            "</joint>",
        ]
    if include_cylinders:
        for part in cylinder_parts(spec):
            lines += _cylinder_part(part, prefix)
    return "\n".join([*lines, "</robot>", ""])


def _link(frame: str, link: LinkSpec, boxes: Sequence[Box]) -> list[str]:
    ixx, iyy, izz = link.inertia
    color = f"{_numbers(link.color)} 1"
    lines = [
        f'<link name="{frame}">',
        f'  <inertial><origin xyz="{_numbers(link.center_of_mass)}"/><mass value="{link.mass!r}"/>',
        f'    <inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>",
    ]
    for box in boxes:
        lines.append(f"  <visual>{_shape(box)}{_material(frame, color)}</visual>")
        lines.append(f"  <collision>{_shape(box)}</collision>")
    return [*lines, "</link>"]


def _cylinder_part(part: CylinderPart, prefix: str) -> list[str]:
    frame = f"{prefix}{part.link}"
    kind, axis = ("prismatic", "1 0 0") if part.is_prismatic else ("continuous", "0 1 0")
    bounds = f'lower="{part.lower!r}" upper="{part.upper!r}" ' if part.is_prismatic else ""
    mimic = f'<mimic joint="{part.mimic}"/>' if part.mimic else ""
    return [
        f'<link name="{frame}">',
        f"  <visual>{_shape(part.box)}{_material(frame, part.color)}</visual>",
        "</link>",
        f'<joint name="{part.joint}" type="{kind}">',
        f'  <parent link="{prefix}{part.parent}"/><child link="{frame}"/>',
        f'  <origin xyz="{_numbers(part.origin)}"/><axis xyz="{axis}"/>',
        f'  <limit {bounds}effort="0" velocity="1e3"/>{mimic}',
        "</joint>",
    ]


def _shape(box: Box) -> str:
    return (
        f'<origin xyz="{_numbers(box.center)}" rpy="0 {box.pitch!r} 0"/>'
        f'<geometry><box size="{_numbers(box.size)}"/></geometry>'
    )


def _material(frame: str, color: str) -> str:
    return f'<material name="{frame}_paint"><color rgba="{color}"/></material>'


def _virtual_base(base: str, prefix: str) -> list[str]:
    lines = ['<link name="map"/>']
    parent = "map"
    for name, (kind, axis) in zip(BASE_JOINTS, _VIRTUAL_AXES, strict=True):
        child = base if name == BASE_JOINTS[-1] else f"{prefix}{name}_link"
        bounds = 'lower="-1e5" upper="1e5" ' if kind == "prismatic" else ""
        if child != base:
            lines.append(f'<link name="{child}"/>')
        lines += [
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>',
            f'  <axis xyz="{axis}"/><limit {bounds}effort="0" velocity="1e3"/>',
            "</joint>",
        ]
        parent = child
    return lines


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)

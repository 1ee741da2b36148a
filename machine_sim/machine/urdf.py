"""URDF text of a machine with boxes as shapes, for the physics; see `description` for the other."""

from __future__ import annotations

import math
from collections.abc import Sequence

from machine_sim.machine.spec import BASE, Box, LinkSpec, MachineSpec

__all__ = [
    "BASE_JOINTS",
    "collision_boxes",
    "inertial_line",
    "joint_lines",
    "link_frame",
    "numbers",
    "shape_text",
    "urdf_text",
    "virtual_base_lines",
]

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


def urdf_text(spec: MachineSpec, *, prefix: str = "", virtual_base: bool = False) -> str:
    """Return the URDF of a machine; the base is `base_link`, the other links keep their names.

    Args:
        spec: specification of the machine.
        prefix: prefix of each link name, so that several machines can share one TF tree.
        virtual_base: add the joints `BASE_JOINTS` from the link `map` to the base, so that joint
            states alone give the pose of the machine; not for the physics engine.
    """
    lines = ['<?xml version="1.0"?>', f'<robot name="{spec.name}">']
    if virtual_base:
        lines += virtual_base_lines(prefix)
    for name, link in spec.links.items():
        frame = link_frame(name, prefix)
        color = f"{numbers(link.color)} 1"
        lines += [f'<link name="{frame}">', inertial_line(link)]
        for box in collision_boxes(spec, name):
            material = f'<material name="{frame}_paint"><color rgba="{color}"/></material>'
            lines.append(f"  <visual>{shape_text(box)}{material}</visual>")
            lines.append(f"  <collision>{shape_text(box)}</collision>")
        lines.append("</link>")
    return "\n".join([*lines, *joint_lines(spec, prefix), "</robot>", ""])


def link_frame(name: str, prefix: str = "") -> str:
    """Return the name of a link in the URDF."""
    return f"{prefix}{'base_link' if name == BASE else name}"


def collision_boxes(spec: MachineSpec, link: str) -> list[Box]:
    """Return the boxes of a link and of its tools."""
    tools = [tool.shape for tool in spec.tools.values() if tool.link == link]
    return [*spec.links[link].boxes, *(box for shape in tools for box in shape.boxes())]


def inertial_line(link: LinkSpec) -> str:
    """Return mass, centre of mass and moments of inertia."""
    ixx, iyy, izz = link.inertia
    return (
        f'  <inertial><origin xyz="{numbers(link.center_of_mass)}"/><mass value="{link.mass!r}"/>\n'
        f'    <inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>"
    )


def joint_lines(spec: MachineSpec, prefix: str) -> list[str]:
    """Return the joints between the links."""
    lines = []
    for name, joint in spec.joints.items():
        bounds = ""
        if math.isfinite(joint.lower):
            bounds = f'lower="{joint.lower!r}" upper="{joint.upper!r}" '
        parent, child = link_frame(joint.parent, prefix), link_frame(joint.child, prefix)
        lines += [
            f'<joint name="{name}" type="{"revolute" if bounds else "continuous"}">',
            f'  <parent link="{parent}"/><child link="{child}"/>',
            f'  <origin xyz="{numbers(joint.origin)}"/><axis xyz="{_AXES[joint.axis]}"/>',
            f'  <limit {bounds}effort="{joint.max_effort!r}" velocity="{joint.max_velocity!r}"/>',
            "</joint>",
        ]
    return lines


def shape_text(box: Box) -> str:
    """Return origin and geometry of a box."""
    return (
        f'<origin xyz="{numbers(box.center)}" rpy="0 {box.pitch!r} 0"/>'
        f'<geometry><box size="{numbers(box.size)}"/></geometry>'
    )


def virtual_base_lines(prefix: str) -> list[str]:
    """Return the link `map` and the joints `BASE_JOINTS` from it to the base."""
    base = link_frame(BASE, prefix)
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


def numbers(values: Sequence[float]) -> str:
    """Return numbers separated by spaces, exactly."""
    return " ".join(repr(float(value)) for value in values)

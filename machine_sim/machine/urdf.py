"""URDF text of a machine: primitive shapes only, for the physics and for robot_state_publisher."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from machine_sim.machine.description import Box, LinkShape, MachineDescription
from machine_sim.machine.pistons import PistonPart, piston_parts

__all__ = ["VIRTUAL_JOINTS", "urdf_text"]

VIRTUAL_JOINTS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
"""Joints from `map` to the base in a URDF that carries the base's pose as joint values."""

_VIRTUAL_AXES = (
    ("prismatic", "1 0 0"),
    ("prismatic", "0 1 0"),
    ("prismatic", "0 0 1"),
    ("continuous", "0 0 1"),
    ("continuous", "0 1 0"),
    ("continuous", "1 0 0"),
)
_COLORS = {
    "base": "0.25 0.25 0.27 1",
    "upper": "0.95 0.70 0.10 1",
    "boom": "0.95 0.70 0.10 1",
    "arm": "0.95 0.70 0.10 1",
    "bucket": "0.35 0.35 0.38 1",
}
_SIDE_SLABS = 6


def urdf_text(
    description: MachineDescription,
    *,
    prefix: str = "",
    virtual_base: bool = False,
    pistons: bool = False,
) -> str:
    """URDF of the machine; links base_link, upper, boom, arm, bucket.

    Args:
        description: the machine.
        prefix: put before each link name, so that several machines share one TF tree.
        virtual_base: add the joints `VIRTUAL_JOINTS` from the link `map` to the base, so that
            joint states alone place the whole machine; the physics does without.
        pistons: add the parts of the cylinders, which are only seen; see `pistons`.
    """
    foot, swing = description.boom_foot, description.swing_origin
    links = description.links
    shell = _bucket_boxes(description)
    frames = {name: f"{prefix}{'base_link' if name == 'base' else name}" for name in links}
    joints = (
        ("swing", "base", "upper", swing, "0 0 1"),
        ("boom", "upper", "boom", foot, "0 1 0"),
        ("arm", "boom", "arm", (description.boom_length, 0.0, 0.0), "0 1 0"),
        ("bucket", "arm", "bucket", (description.arm_length, 0.0, 0.0), "0 1 0"),
    )
    lines = ['<?xml version="1.0"?>', f'<robot name="{description.name}">']
    if virtual_base:
        lines += _virtual_base(frames["base"], prefix)
    for name, link in links.items():
        boxes = (*link.boxes, *shell) if name == "bucket" else link.boxes
        lines += _link(frames[name], link, boxes, _COLORS[name])
    for name, parent, child, origin, axis in joints:
        limits = description.joints[name]
        bounds = ""
        if math.isfinite(limits.lower):
            bounds = f'lower="{limits.lower!r}" upper="{limits.upper!r}" '
        lines += [
            f'<joint name="{name}" type="{"revolute" if bounds else "continuous"}">',
            f'  <parent link="{frames[parent]}"/><child link="{frames[child]}"/>',
            f'  <origin xyz="{_numbers(origin)}"/><axis xyz="{axis}"/>',
            f'  <limit {bounds}effort="{limits.torque!r}" velocity="{limits.speed!r}"/>',
            "</joint>",
        ]
    if pistons:
        for part in piston_parts(description):
            lines += _piston(part, prefix)
    return "\n".join([*lines, "</robot>", ""])


def _link(frame: str, link: LinkShape, boxes: Sequence[Box], color: str) -> list[str]:
    ixx, iyy, izz = link.inertia
    lines = [
        f'<link name="{frame}">',
        f'  <inertial><origin xyz="{_numbers(link.center_of_mass)}"/><mass value="{link.mass!r}"/>',
        f'    <inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>",
    ]
    for box in boxes:
        lines.append(f"  <visual>{_shape(box)}{_paint(frame, color)}</visual>")
        lines.append(f"  <collision>{_shape(box)}</collision>")
    return [*lines, "</link>"]


def _piston(part: PistonPart, prefix: str) -> list[str]:
    frame = f"{prefix}{part.link}"
    kind, axis = ("prismatic", "1 0 0") if part.slides else ("continuous", "0 1 0")
    bounds = f'lower="{part.lower!r}" upper="{part.upper!r}" ' if part.slides else ""
    mimics = f'<mimic joint="{part.mimics}"/>' if part.mimics else ""
    return [
        f'<link name="{frame}">',
        f"  <visual>{_shape(part.box)}{_paint(frame, part.color)}</visual>",
        "</link>",
        f'<joint name="{part.joint}" type="{kind}">',
        f'  <parent link="{prefix}{part.parent}"/><child link="{frame}"/>',
        f'  <origin xyz="{_numbers(part.origin)}"/><axis xyz="{axis}"/>',
        f'  <limit {bounds}effort="0" velocity="1e3"/>{mimics}',
        "</joint>",
    ]


def _shape(box: Box) -> str:
    return (
        f'<origin xyz="{_numbers(box.center)}" rpy="0 {box.pitch!r} 0"/>'
        f'<geometry><box size="{_numbers(box.size)}"/></geometry>'
    )


def _paint(frame: str, color: str) -> str:
    return f'<material name="{frame}_paint"><color rgba="{color}"/></material>'


def _bucket_boxes(description: MachineDescription) -> list[Box]:
    """The bucket's shell: a box for each floor strip, slabs for each side wall."""
    bucket = description.bucket
    plate, width = bucket.plate, bucket.width
    boxes = []
    for a, b in zip(bucket.profile[:-1], bucket.profile[1:], strict=True):
        middle, edge = 0.5 * (a + b), b - a
        boxes.append(
            Box(
                (float(np.hypot(*edge)), width, plate),
                (float(middle[0]), 0.0, float(middle[1])),
                math.atan2(-edge[1], edge[0]),
            )
        )
    # A side wall in slabs that stand on the mouth and reach up to the shell.
    along = (bucket.profile[-1] - bucket.profile[0]) / bucket.mouth_length
    inward = -bucket.mouth_normal[[0, 2]]
    local = bucket.profile - bucket.profile[0]
    u, depth = local @ along, local @ inward
    step = bucket.mouth_length / _SIDE_SLABS
    for k in range(_SIDE_SLABS):
        at = (k + 0.5) * step
        high = float(np.interp(at, u, depth))
        x, z = bucket.profile[0] + at * along + 0.5 * high * inward
        boxes += [
            Box(
                (step, plate, high),
                (float(x), side * 0.5 * (width + plate), float(z)),
                math.atan2(-along[1], along[0]),
            )
            for side in (+1, -1)
        ]
    return boxes


def _virtual_base(base: str, prefix: str) -> list[str]:
    lines = ['<link name="map"/>']
    parent = "map"
    for name, (kind, axis) in zip(VIRTUAL_JOINTS, _VIRTUAL_AXES, strict=True):
        child = base if name == VIRTUAL_JOINTS[-1] else f"{prefix}{name}_link"
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

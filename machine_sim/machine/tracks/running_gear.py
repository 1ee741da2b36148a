"""Running gear of the hinged tracks: their geometry, and the URDF of sprockets and idlers.

Each side has a sprocket behind and an idler on a sliding yoke in front. Half a turn of the sprocket
takes up three shoes: it is a hexagon whose flats fit them. A round one would slip under the chords
of the chain and throw it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import MachineSpec, TrackSpec, Vec3
from machine_sim.machine.urdf import urdf_text

__all__ = [
    "NUM_SPROCKET_FLATS",
    "SIDES",
    "SPROCKET_CORNER_ANGLE",
    "initial_shoe_poses",
    "urdf_with_running_gear",
    "with_dynamic_tracks",
]

Array = NDArray[np.float64]

SIDES = ("left", "right")
"""Sides of the machine, as in the names of the joints sprocket_left, idler_left and so on."""

NUM_SPROCKET_FLATS = 6
"""Flats of the sprocket; half of them carry shoes."""

SPROCKET_CORNER_ANGLE = 2.0 * math.pi / NUM_SPROCKET_FLATS
"""From one corner of the sprocket to the next [rad]; at angle 0 one is right below the axle."""

_WHEEL_FRICTION = 3.0
"""Coefficient of the sprocket; multiplied with a shoe's it stands for teeth."""

_WHEEL_WIDTH_FACTOR = 0.83
"""In parts of a shoe's."""

_WHEEL_MASS_FACTOR = 0.15
"""In parts of one belt's."""

_WHEEL_CLEARANCE = 0.002
"""Between wheels and shoes of a chain without tension [m]."""

_YOKE_LIMITS = (-0.01, 0.06)
"""Limits of the idler's way forward [m]."""


def with_dynamic_tracks(spec: MachineSpec) -> MachineSpec:
    """The same machine with its tracks as hinged shoes have them.

    A flat run is a whole number of shoes and a shoe is as long as the sprocket's radius, as near to
    the description's radius as that allows. What one shoe feels of the ground follows from their
    number. A machine that is so already stays as it is.
    """
    shape = spec.tracks
    run = max(round(shape.axle_distance / shape.sprocket_radius), 2)
    count = 2 * run + NUM_SPROCKET_FLATS
    share = shape.shoe_count / count
    tracks = replace(
        shape,
        shoe_count=count,
        sprocket_radius=shape.axle_distance / run,
        normal_stiffness=share * shape.normal_stiffness,
        normal_damping=share * shape.normal_damping,
        tangential_stiffness=share * shape.tangential_stiffness,
        tangential_damping=share * shape.tangential_damping,
    )
    return replace(spec, tracks=tracks)


def initial_shoe_poses(shape: TrackSpec) -> Array:
    """Middles x, z [m] and pitch about +y [rad] of a new chain's shoes in the base frame.

    A shoe's x points to the next one, the way it goes when the machine drives forward: backward
    below, round the sprocket, forward above. Its z points out of the track. Shape (shoe_count, 3).
    """
    half, radius = 0.5 * shape.axle_distance, shape.sprocket_radius
    run = (shape.shoe_count - NUM_SPROCKET_FLATS) // 2
    turns = SPROCKET_CORNER_ANGLE * np.arange(NUM_SPROCKET_FLATS // 2)
    below = np.column_stack([half - radius * np.arange(run), np.full(run, -radius)])
    behind = np.column_stack([-half - radius * np.sin(turns), -radius * np.cos(turns)])
    # The other half of the chain is this one, turned by half a turn about +y.
    hinges = np.vstack([below, behind, -below, -behind])
    step = np.roll(hinges, -1, axis=0) - hinges
    middles = hinges + 0.5 * step
    pitch = np.arctan2(-step[:, 1], step[:, 0])
    return np.column_stack([middles[:, 0], middles[:, 1] + shape.axle_height, pitch])


def urdf_with_running_gear(spec: MachineSpec) -> str:
    """URDF of a machine with sprockets and idlers; its base is lighter by them and by the shoes.

    Args:
        description: from `with_dynamic_tracks`.

    Raises:
        MachineError: the base is too light for its tracks, or the shoes too thick for a wheel.
    """
    shape, base = spec.tracks, spec.links["base"]
    tracks = 2.0 * shape.belt_mass * (1.0 + 2.0 * _WHEEL_MASS_FACTOR)
    if not base.mass > tracks:
        raise MachineError(
            f"links.base.mass is {base.mass} kg, of which the tracks with their wheels are"
            f" {tracks:.0f} kg; give a heavier base or a lighter tracks.belt_mass"
        )
    radius = _wheel_radius(shape)
    if not radius > 0.0:
        raise MachineError(
            f"tracks.shoe_thickness is {shape.shoe_thickness} m, too thick for a sprocket of"
            f" {shape.sprocket_radius:.3f} m; give thinner shoes"
        )
    lighter = replace(base, mass=base.mass - tracks)
    machine = replace(spec, links={**spec.links, "base": lighter})
    wheels = [line for side in (1, -1) for line in _wheels(shape, radius, side)]
    return urdf_text(machine).replace("</robot>", "\n".join([*wheels, "</robot>"]))


def _wheel_radius(shape: TrackSpec) -> float:
    """Radius of the idler [m], and of the circle in the sprocket: under the chords of the chain."""
    chord = shape.sprocket_radius * math.cos(0.5 * SPROCKET_CORNER_ANGLE)
    return chord - 0.5 * shape.shoe_thickness - _WHEEL_CLEARANCE


def _wheels(shape: TrackSpec, radius: float, side: int) -> list[str]:
    """Links and joints of the left (1) or right (-1) side."""
    name = SIDES[0] if side > 0 else SIDES[1]
    half, y, z = 0.5 * shape.axle_distance, 0.5 * side * shape.gauge, shape.axle_height
    width = _WHEEL_WIDTH_FACTOR * shape.shoe_width
    flat = 2.0 * radius * math.tan(0.5 * SPROCKET_CORNER_ANGLE)
    box = f'<box size="{flat!r} {width!r} {2.0 * radius!r}"/>'
    # Boxes about one axis, each of two flats; one of them stands upright.
    hexagon = [
        _shape(box, f"0 {0.5 * math.pi + k * SPROCKET_CORNER_ANGLE!r} 0")
        for k in range(NUM_SPROCKET_FLATS // 2)
    ]
    disc = _shape(f'<cylinder radius="{radius!r}" length="{width!r}"/>', f"{0.5 * math.pi!r} 0 0")
    slide = (
        f'<limit lower="{_YOKE_LIMITS[0]}" upper="{_YOKE_LIMITS[1]}" effort="1e7" velocity="10"/>'
    )
    mass = _WHEEL_MASS_FACTOR * shape.belt_mass
    across = mass * (3.0 * radius**2 + width**2) / 12.0
    inertia = (across, 0.5 * mass * radius**2, across)
    return [
        *_link(f"sprocket_{name}", mass, inertia, _WHEEL_FRICTION, hexagon),
        *_joint(f"sprocket_{name}", "continuous", (-half, y, z), '<axis xyz="0 1 0"/>'),
        *_link(f"idler_{name}", mass, inertia, 0.0, [disc]),
        *_joint(f"idler_{name}", "prismatic", (half, y, z), f'<axis xyz="1 0 0"/>{slide}'),
    ]


def _shape(geometry: str, turn: str) -> str:
    return (
        f'  <collision><origin xyz="0 0 0" rpy="{turn}"/><geometry>{geometry}</geometry>'
        "</collision>"
    )


def _link(name: str, mass: float, inertia: Vec3, friction: float, shapes: list[str]) -> list[str]:
    ixx, iyy, izz = inertia
    return [
        f'<link name="{name}">',
        f'  <contact><lateral_friction value="{friction!r}"/></contact>',
        f'  <inertial><mass value="{mass!r}"/>',
        f'    <inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>",
        *shapes,
        "</link>",
    ]


def _joint(name: str, kind: str, at: Vec3, motion: str) -> list[str]:
    x, y, z = at
    return [
        f'<joint name="{name}" type="{kind}">',
        f'  <parent link="base_link"/><child link="{name}"/><origin xyz="{x!r} {y!r} {z!r}"/>',
        f"  {motion}",
        "</joint>",
    ]

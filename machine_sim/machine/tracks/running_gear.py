"""Running gear of the dynamic tracks: geometry of the chains, and URDF of sprockets and idlers.

Each side has a sprocket at the rear and an idler on a sliding yoke at the front. Three shoes lie on
half the circumference of the sprocket, which is a hexagon whose flats fit them. A round sprocket
would slip under the chords of the chain and throw it off.
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
"""Sides of the machine in the names of joints: sprocket_left, idler_left, ..."""

NUM_SPROCKET_FLATS = 6
"""Number of flats of the sprocket; half of them carry shoes."""

SPROCKET_CORNER_ANGLE = 2.0 * math.pi / NUM_SPROCKET_FLATS
"""Angle between corners of the sprocket [rad]; at joint angle 0 one is below the axle."""

_WHEEL_FRICTION = 3.0
"""Friction coefficient of the sprocket; multiplied by a shoe's it replaces teeth."""

_WHEEL_WIDTH_FACTOR = 0.83
"""Width of a wheel in widths of a shoe."""

_WHEEL_MASS_FACTOR = 0.15
"""Mass of a wheel in masses of one belt."""

_WHEEL_CLEARANCE = 0.002
"""Clearance between wheels and shoes of a chain without tension [m]."""

_YOKE_LIMITS = (-0.01, 0.06)
"""Limits of the idler's displacement, positive forward [m]."""


def with_dynamic_tracks(spec: MachineSpec) -> MachineSpec:
    """Return a machine with the number and size of shoes that the dynamic tracks need.

    A run is a whole number of shoes long, and a shoe is as long as the radius of the sprocket,
    which is as close to the specified radius as that allows. The contact stiffness of a shoe is
    scaled so that the stiffness of the belt stays the same. Applied twice, the function changes
    nothing.
    """
    tracks = spec.tracks
    run = max(round(tracks.axle_distance / tracks.sprocket_radius), 2)
    count = 2 * run + NUM_SPROCKET_FLATS
    scale = tracks.shoe_count / count
    dynamic_tracks = replace(
        tracks,
        shoe_count=count,
        sprocket_radius=tracks.axle_distance / run,
        normal_stiffness=scale * tracks.normal_stiffness,
        normal_damping=scale * tracks.normal_damping,
        tangential_stiffness=scale * tracks.tangential_stiffness,
        tangential_damping=scale * tracks.tangential_damping,
    )
    return replace(spec, tracks=dynamic_tracks)


def initial_shoe_poses(tracks: TrackSpec) -> Array:
    """Return centre x, z [m] and pitch about +y [rad] of a new chain's shoes, base frame.

    The x axis of a shoe points to the next one, in its direction of motion when the machine drives
    forward: backward on the lower run, around the sprocket, forward on the upper run. Its z axis
    points out of the track. Shape (shoe_count, 3).
    """
    half, radius = 0.5 * tracks.axle_distance, tracks.sprocket_radius
    run = (tracks.shoe_count - NUM_SPROCKET_FLATS) // 2
    turns = SPROCKET_CORNER_ANGLE * np.arange(NUM_SPROCKET_FLATS // 2)
    below = np.column_stack([half - radius * np.arange(run), np.full(run, -radius)])
    behind = np.column_stack([-half - radius * np.sin(turns), -radius * np.cos(turns)])
    # The other half of the chain is this one, rotated by pi about +y.
    hinges = np.vstack([below, behind, -below, -behind])
    step = np.roll(hinges, -1, axis=0) - hinges
    middles = hinges + 0.5 * step
    pitch = np.arctan2(-step[:, 1], step[:, 0])
    return np.column_stack([middles[:, 0], middles[:, 1] + tracks.axle_height, pitch])


def urdf_with_running_gear(spec: MachineSpec) -> str:
    """Return the URDF of a machine with sprockets and idlers.

    The mass of wheels and shoes is subtracted from that of the base.

    Args:
        spec: machine from `with_dynamic_tracks`.

    Raises:
        MachineError: the base is too light for its tracks, or the shoes too thick for a wheel.
    """
    tracks, base = spec.tracks, spec.links["base"]
    tracks_mass = 2.0 * tracks.belt_mass * (1.0 + 2.0 * _WHEEL_MASS_FACTOR)
    if not base.mass > tracks_mass:
        raise MachineError(
            f"links.base.mass is {base.mass} kg and must be more than the {tracks_mass:.0f} kg of"
            " the tracks; give a heavier base or a lighter tracks.belt_mass"
        )
    radius = _wheel_radius(tracks)
    if not radius > 0.0:
        raise MachineError(
            f"tracks.shoe_thickness is {tracks.shoe_thickness} m, too thick for a sprocket of"
            f" {tracks.sprocket_radius:.3f} m; give thinner shoes"
        )
    lighter = replace(base, mass=base.mass - tracks_mass)
    machine = replace(spec, links={**spec.links, "base": lighter})
    wheels = [line for side in (1, -1) for line in _wheels(tracks, radius, side)]
    return urdf_text(machine).replace("</robot>", "\n".join([*wheels, "</robot>"]))


def _wheel_radius(tracks: TrackSpec) -> float:
    """Return the radius of the idler [m] and of the inscribed circle of the sprocket."""
    chord = tracks.sprocket_radius * math.cos(0.5 * SPROCKET_CORNER_ANGLE)
    return chord - 0.5 * tracks.shoe_thickness - _WHEEL_CLEARANCE


def _wheels(tracks: TrackSpec, radius: float, side: int) -> list[str]:
    """Return links and joints of the left (1) or right (-1) side."""
    name = SIDES[0] if side > 0 else SIDES[1]
    half, y, z = 0.5 * tracks.axle_distance, 0.5 * side * tracks.gauge, tracks.axle_height
    width = _WHEEL_WIDTH_FACTOR * tracks.shoe_width
    flat = 2.0 * radius * math.tan(0.5 * SPROCKET_CORNER_ANGLE)
    box = f'<box size="{flat!r} {width!r} {2.0 * radius!r}"/>'
    # Boxes about one axis, with two flats each; one of them is vertical.
    hexagon = [
        _shape(box, f"0 {0.5 * math.pi + k * SPROCKET_CORNER_ANGLE!r} 0")
        for k in range(NUM_SPROCKET_FLATS // 2)
    ]
    disc = _shape(f'<cylinder radius="{radius!r}" length="{width!r}"/>', f"{0.5 * math.pi!r} 0 0")
    slide = (
        f'<limit lower="{_YOKE_LIMITS[0]}" upper="{_YOKE_LIMITS[1]}" effort="1e7" velocity="10"/>'
    )
    mass = _WHEEL_MASS_FACTOR * tracks.belt_mass
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

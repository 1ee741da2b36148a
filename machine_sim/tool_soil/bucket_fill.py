"""Soil in a bucket, and the room for more, measured in one pass of the end of a tick."""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.tool_soil.edge_soil import swell_at_point
from machine_sim.tool_soil.payload import Payload, payload_of, sum_inside
from machine_sim.tool_soil.soil_level import room_below_level
from msg_bridge.kernels import fixed_signature_kernel

__all__ = ["BucketFill", "measure_bucket"]


class BucketFill(NamedTuple):
    """Soil in a bucket, and the room for more.

    Attributes:
        payload: soil in the bucket and heaped on it.
        room_below_level: loose volume that goes into it before the soil ahead yields [m^3];
            see `soil_level`.
        swell: of the soil at its cutting edge, which it will take in.
    """

    payload: Payload
    room_below_level: float
    swell: float


def measure_bucket(shape: BucketShape, particles: SoilEngine, pose: Pose) -> BucketFill:
    """Measure the fill of a bucket.

    Args:
        shape: its shape; the first point of its profile is the lip.
        particles: the particle engine, with the ground.
        pose: rotation bucket to map, shape (3, 3), and origin [m], shape (3,).
    """
    ground = particles.ground
    bank_mm3, loose_mm3, mass_kg, room, swell = _measure(
        shape.boxed,
        shape.key_points,
        *pose,
        particles.boxed_columns,
        particles.swells,
        ground.elevation,
        ground.soil,
        ground.frame,
        float(ground.grid.cell),
    )
    payload = payload_of(bank_mm3, loose_mm3, mass_kg, shape.heaped_capacity)
    return BucketFill(payload, room, swell)


@fixed_signature_kernel
def _measure(  # type: ignore[no-untyped-def]
    boxed_container,
    key_points,
    rotation,
    origin,
    boxed_particles,
    swells,
    elevation,
    soil,
    frame,
    cell,
):
    """Measure the parts of a `BucketFill`.

    Args:
        boxed_container: `ContainerTable`, boxed.
        key_points: its key points [m], bucket frame; the first is on the cutting edge.
        rotation, origin: pose of the bucket.
        boxed_particles: `ParticleColumns`, boxed.
        swells: swell of each soil.
        elevation, soil, frame: of `Ground`.
        cell: size of a cell [m].

    Returns:
        Bank volume [mm^3], loose volume [mm^3] and mass [kg] of the payload, room below the level
        of the soil ahead [m^3], and swell.
    """
    container, particles = boxed_container.table, boxed_particles.table
    bank, loose, mass, struck = sum_inside(container, rotation, origin, particles, swells)
    room = room_below_level(container, rotation, origin, elevation, frame, struck)
    swell = swell_at_point(key_points[0], rotation, origin, soil, frame, cell, swells)
    return bank, loose, mass, room, swell

"""Contacts of particles with the terrain: a tangent plane per particle and step.

For one step, the ground under a particle near it is a plane fitted to the terrain. The slope is
taken across the particle's own diameter: a bilinear surface has creases between columns, and a
normal that jumps there would eject a particle from the foot of a cliff.

Beside a digging tool the surface is known only as the mean of columns that are partly cut: the face
ahead of a bucket's lip is smeared over a column or two, and soil in front of the lip seems to lie
deep under it. Contacts of particles there are *penetration-limited*: the spring force is capped, so
that the ground pushes them out slowly, and they are never put back onto the surface. A particle
that leaves the tool while it is still below ground stays penetration-limited until it is out: the
full spring force on so deep a particle would eject it.

The same holds for a particle that the ground has risen into, as when soil slides over it, or that
has run into a wall that its plane did not show: its overlap has increased from the end of one step
to the start of the next, and the energy of the spring is none that the particle had.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.dem.contacts.failing_ground import failing_ground_velocity
from machine_sim.dem.contacts.ground_contact_blocks import (
    GroundContactBlocks,
    allocate_ground_blocks,
)
from machine_sim.dem.partition import NUM_CHUNKS
from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET, PLANE_SIZE
from machine_sim.dem.tools.pose import ORIGIN, velocity_at
from machine_sim.dem.tools.tool_set import NO_TOOL
from machine_sim.dem.vec3 import dot, load_row, store_row, subtract
from machine_sim.ground.contact_surface import Ground, surface_at
from msg_bridge.kernels import BoxedTable, box_table, helper, threaded_helper

__all__ = [
    "GroundContactList",
    "GroundContacts",
    "GroundData",
    "first_ground_contacts",
    "list_ground_contacts",
    "max_limited_overlap",
    "reset_spring",
    "terrain_height",
]

_MAX_LIMITED_ACCELERATION = 100.0
"""Maximum acceleration by the spring of a penetration-limited contact [m/s^2]."""
_MAX_RISE = 0.1
"""Increase of the overlap between two steps, in radii, above which the ground has risen."""
_CLIFF_CLEARANCE = 10.0
"""Height above the ground, in radii, at which a centre is clear of any cliff beside it."""
_SEARCH_RADIUS_FACTOR = 1.2
"""Distance to the ground at which a particle at rest is listed, in radii."""
_ACCELERATION_MARGIN = 1.3
"""Distance ahead that is searched, over the distance travelled in a step at constant velocity."""


class GroundContacts(NamedTuple):
    """Particles that may touch the ground within a step, and their tangent planes.

    Attributes:
        row: rows of the particles, int64, shape (n,).
        plane: their packed planes, normals upward, shape (n, PLANE_SIZE), see `tools.plane`.
        velocity: velocity of the ground there [m/s], shape (n, 3), see `failing_ground`.
    """

    row: NDArray[np.int64]
    plane: NDArray[np.float64]
    velocity: NDArray[np.float64]


class GroundData(NamedTuple):
    """The terrain, and memory for contacts with it.

    Attributes:
        surface: contact surface [m], shape (rows, cols).
        frame: see `Ground.frame`.
        cell: size of a cell [m].
        changed: see `Ground.changed`.
        contacts, blocks: arrays with room for all contacts of a step.
    """

    surface: NDArray[np.float64]
    frame: tuple[float, float, float]
    cell: float
    changed: NDArray[np.bool_]
    contacts: GroundContacts
    blocks: GroundContactBlocks


class GroundContactList:
    """Memory for the particles that may touch the ground, listed once per step.

    Attributes:
        boxed_data: `GroundData`, boxed, for kernels.
    """

    def __init__(self, ground: Ground) -> None:
        self._ground = ground
        self._allocate(0)

    def reserve(self, count: int) -> None:
        """Make room for a number of contacts."""
        if self._capacity < count:
            self._allocate(2 * count)

    def _allocate(self, count: int) -> None:
        ground = self._ground
        self._capacity = count
        self.boxed_data: BoxedTable = box_table(
            GroundData(
                ground.surface,
                ground.frame,
                ground.grid.cell,
                ground.changed,
                GroundContacts(
                    np.zeros(count, np.int64), np.zeros((count, PLANE_SIZE)), np.zeros((count, 3))
                ),
                allocate_ground_blocks(count),
            )
        )


@helper(allocates=True, forceinline=True)
def first_ground_contacts(contacts, count):  # type: ignore[no-untyped-def]
    """Return the first `GroundContacts` of a table."""
    row, plane, velocity = contacts
    return GroundContacts(row[:count], plane[:count], velocity[:count])


@helper(forceinline=True)
def max_limited_overlap(params):  # type: ignore[no-untyped-def]
    """Return the overlap [m] above which the spring force of a limited contact is constant."""
    return _MAX_LIMITED_ACCELERATION / np.float64(params.normal_stiffness)


@helper(forceinline=True)
def terrain_height(surface, frame, x, y):  # type: ignore[no-untyped-def]
    """Return the terrain height [m] at (x, y)."""
    x_first, y_first, inverse_cell = frame
    return surface_at(surface, x_first, y_first, inverse_cell, x, y)[0]


@threaded_helper
def list_ground_contacts(  # type: ignore[no-untyped-def]
    surface, frame, dt, params, rows, ground_masked, near_tool, particles, tools, contacts,
):  # fmt: skip
    """List the particles that may touch the ground within a step, with their planes.

    Tangential springs of particles out of reach are reset, and the marks of penetration-limited
    particles are updated. Contacts are listed in chunks of the rows, then the gaps between the
    chunks are closed.

    Args:
        surface, frame: arrays of `Ground`.
        dt: length of the step [s].
        params: `ContactParameters` at the ground.
        rows: particles moved by forces.
        ground_masked, near_tool: of each of these, see `tools.near_tools`.
        particles: `ParticleColumns`.
        tools: `ToolMotion`.
        contacts: out, `GroundContacts` with room for all rows.

    Returns:
        Number of contacts.
    """
    row, plane, ground_velocity = contacts
    # Arrays: a parallel loop takes no tables within tables.
    pose, twist, pushes_ground = tools.path[0], tools.twist, tools.pushes_ground
    num_found = np.zeros(NUM_CHUNKS, np.int64)
    for c in prange(NUM_CHUNKS):
        low, high = c * rows.size // NUM_CHUNKS, (c + 1) * rows.size // NUM_CHUNKS
        num_found[c] = _fit_planes(
            surface, frame, dt, params, rows[low:high], ground_masked[low:high],
            near_tool[low:high], particles, pose, twist, pushes_ground, row[low:high],
            plane[low:high], ground_velocity[low:high],
        )  # fmt: skip
    count = 0
    for c in range(NUM_CHUNKS):
        low = c * rows.size // NUM_CHUNKS
        for k in range(num_found[c]):
            row[count + k] = row[low + k]
            for axis in range(PLANE_SIZE):
                plane[count + k, axis] = plane[low + k, axis]
            store_row(ground_velocity, count + k, 0, load_row(ground_velocity, low + k, 0))
        count += num_found[c]
    return count


@helper(forceinline=True)
def _fit_slopes(surface, frame, x, y, r):  # type: ignore[no-untyped-def]
    """Return the mean slopes of the terrain along x and y across 2 r [m] about (x, y)."""
    rise_x = terrain_height(surface, frame, x + r, y) - terrain_height(surface, frame, x - r, y)
    rise_y = terrain_height(surface, frame, x, y + r) - terrain_height(surface, frame, x, y - r)
    return rise_x / (2 * r), rise_y / (2 * r)


@helper(forceinline=True)
def _fit_planes(  # type: ignore[no-untyped-def]
    surface, frame, dt, params, rows, ground_masked, near_tool, particles, pose, twist,
    pushes_ground, row, plane, ground_velocity,
):  # fmt: skip
    """List the contacts of a chunk; return their number."""
    position, velocity, radius = particles.position, particles.velocity, particles.radius
    contact_radius, spring = particles.contact_radius, particles.ground_spring
    penetration_limited, old_overlap = particles.penetration_limited, particles.ground_overlap
    x_first, y_first, inverse_cell = frame
    limited_overlap = max_limited_overlap(params)
    count = 0
    for k in range(rows.size):
        if ground_masked[k]:
            continue
        i = np.uint64(rows[k])
        was_limited, overlap_before = penetration_limited[i], np.float64(old_overlap[i])
        is_near = near_tool[k] != NO_TOOL
        penetration_limited[i], old_overlap[i] = is_near, np.float32(0.0)
        x, y, z = load_row(position, i, 0)
        r = np.float64(radius[i])
        speed2 = dot(load_row(velocity, i, 0), load_row(velocity, i, 0))
        reach = _SEARCH_RADIUS_FACTOR * r + _ACCELERATION_MARGIN * dt * np.sqrt(speed2)
        height, slope_x, slope_y = surface_at(surface, x_first, y_first, inverse_cell, x, y)
        above = z - height
        inverse_nz = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        if above > max(_CLIFF_CLEARANCE * r, reach) and above > reach * inverse_nz:
            reset_spring(spring, i)
            continue
        slope_x, slope_y = _fit_slopes(surface, frame, x, y, r)
        nz = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        if above * nz > reach:
            reset_spring(spring, i)
            continue
        overlap = contact_radius[i] - above * nz
        # A centre that is more than a radius below ground is put back (`ground_recovery`).
        has_risen = overlap - overlap_before > _MAX_RISE * contact_radius[i] and above * nz > -r
        is_deep = overlap > limited_overlap
        penetration_limited[i] = is_near or (is_deep and (was_limited or has_risen))
        normal = -slope_x * nz, -slope_y * nz, nz
        row[count] = i
        store_row(plane, count, PLANE_NORMAL, normal)
        plane[count, PLANE_OFFSET] = dot(normal, (x, y, height))
        store_row(ground_velocity, count, 0, (0.0, 0.0, 0.0))
        t = near_tool[k]
        if is_near and pushes_ground[t]:
            arm = subtract((x, y, z), load_row(pose, t, ORIGIN))
            velocity_of_tool = velocity_at(twist[t], *arm)
            store_row(ground_velocity, count, 0, failing_ground_velocity(normal, velocity_of_tool))
        count += 1
    return count


@helper(forceinline=True)
def reset_spring(spring, i):  # type: ignore[no-untyped-def]
    """Set the tangential spring of particle `i` to zero."""
    spring[i, 0] = spring[i, 1] = spring[i, 2] = np.float32(0.0)

"""Cubes on the terrain, which changes all the time and therefore is not in pybullet.

Before each step the velocity of a cube that would enter the surface is changed so that it does not:
by impulses (`ground_impulses`) at its eight corners, and under its centre for ridges narrower than
the cube. A cube that is in the surface already comes out at a bounded
speed. The effect of other cubes in the coming step is not known here. It is expected to be the same
as in the last step, so that a pile rests on its lowest layer.

Near a tool that digs cubes are *penetration-limited*, as particles are (see
`dem.contacts.ground_contacts`): they are pushed out slowly and never put back on the surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleState
from machine_sim.ground.contact_surface import surface_at
from machine_sim.reference_cubes.ground_impulses import ContactPoints, solve_impulses
from msg_bridge.kernels import helper, kernel

__all__ = ["CubeView", "ExpectedChange", "finish_ground_contacts", "resolve_ground_contacts"]

_NUM_CORNERS = 8
_NUM_CONTACT_POINTS = 9
"""Possible contact points of a cube: its corners and the point under its centre."""
_RECOVERY_FRACTION = 0.2
"""Fraction of its depth by which a point comes out in a step."""
_MAX_RECOVERY_SPEED, _MAX_LIMITED_RECOVERY_SPEED = 1.0, 0.3
"""Maximum speed at which it comes out [m/s]; the second of penetration-limited cubes."""
_SQRT3 = np.sqrt(3.0)


class CubeView(NamedTuple):
    """Columns of `ParticleState` that ground contacts use; `half_edge` is its `radius`."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float32]
    half_edge: NDArray[np.float32]
    penetration_limited: NDArray[np.bool_]

    @classmethod
    def of(cls, state: ParticleState) -> CubeView:
        """Return views of the columns of a state."""
        return cls(
            state.position,
            state.velocity,
            state.angular_velocity,
            state.radius,
            state.penetration_limited,
        )


class ExpectedChange(NamedTuple):
    """Changes of motion that are expected in the coming step.

    Attributes:
        velocity, angular_velocity: by other cubes and tools [m/s], [rad/s], shape (n, 3).
        gravity_delta_v: increase of the downward velocity by gravity [m/s].
    """

    velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float64]
    gravity_delta_v: float


@helper(forceinline=True)
def _slopes(surface, ground, x, y, reach):  # type: ignore[no-untyped-def]
    """Return dz/dx and dz/dy across `reach` [m] on each side, past the creases between columns."""
    east = surface_at(surface, ground[0], ground[1], ground[2], x + reach, y)[0]
    west = surface_at(surface, ground[0], ground[1], ground[2], x - reach, y)[0]
    north = surface_at(surface, ground[0], ground[1], ground[2], x, y + reach)[0]
    south = surface_at(surface, ground[0], ground[1], ground[2], x, y - reach)[0]
    return (east - west) / (2.0 * reach), (north - south) / (2.0 * reach)


@kernel
def resolve_ground_contacts(  # type: ignore[no-untyped-def]
    surface, ground, dt, friction, skip_ground, near_digging_tool, cubes, quaternion, expected
):
    """Change velocities so that a step of `dt` [s] leaves the cubes above the ground.

    Args:
        surface, ground: contact surface [m] and `Ground.frame`.
        dt: [s].
        friction: Coulomb coefficient.
        skip_ground: cubes without ground contact, shape (n,).
        near_digging_tool: cubes near a tool that digs, shape (n,).
        cubes: `CubeView`; velocities and `penetration_limited` are updated.
        quaternion: attitudes x y z w, shape (n, 4).
        expected: `ExpectedChange` of the step.
    """
    points = ContactPoints(
        np.empty((_NUM_CONTACT_POINTS, 3)),
        np.empty(_NUM_CONTACT_POINTS),
        np.empty(_NUM_CONTACT_POINTS),
        np.empty((_NUM_CONTACT_POINTS, 3)),
    )
    limited, velocity, angular_velocity = (
        cubes.penetration_limited,
        cubes.velocity,
        cubes.angular_velocity,
    )
    for i in range(cubes.position.shape[0]):
        if skip_ground[i]:
            continue
        h = np.float64(cubes.half_edge[i])
        x, y, z = cubes.position[i, 0], cubes.position[i, 1], cubes.position[i, 2]
        vx = velocity[i, 0] + expected.velocity[i, 0]
        vy = velocity[i, 1] + expected.velocity[i, 1]
        vz = velocity[i, 2] + expected.velocity[i, 2] - expected.gravity_delta_v
        height = z - surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]
        limited[i] = near_digging_tool[i] or (limited[i] and height < -h)
        slope_x, slope_y = _slopes(surface, ground, x, y, _SQRT3 * h)
        nz = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        normal = (-slope_x * nz, -slope_y * nz, nz)
        max_speed = _MAX_LIMITED_RECOVERY_SPEED if limited[i] else _MAX_RECOVERY_SPEED
        reach = dt * (np.sqrt(vx * vx + vy * vy + vz * vz) + 2.0 * h * _norm(angular_velocity, i))
        num_points = _find_contact_points(
            surface, ground, dt, (x, y, z), h, quaternion[i], height, nz, reach, max_speed, points
        )
        if num_points == 0:
            continue
        wx = angular_velocity[i, 0] + expected.angular_velocity[i, 0]
        wy = angular_velocity[i, 1] + expected.angular_velocity[i, 1]
        wz = angular_velocity[i, 2] + expected.angular_velocity[i, 2]
        vx, vy, vz, wx, wy, wz = solve_impulses(
            points, num_points, normal, friction, h, (vx, vy, vz), (wx, wy, wz)
        )
        velocity[i, 0] = vx - expected.velocity[i, 0]
        velocity[i, 1] = vy - expected.velocity[i, 1]
        velocity[i, 2] = vz - expected.velocity[i, 2] + expected.gravity_delta_v
        angular_velocity[i, 0] = wx - expected.angular_velocity[i, 0]
        angular_velocity[i, 1] = wy - expected.angular_velocity[i, 1]
        angular_velocity[i, 2] = wz - expected.angular_velocity[i, 2]


@helper
def _find_contact_points(  # type: ignore[no-untyped-def]
    surface, ground, dt, centre, h, quaternion, height, nz, reach, max_speed, points
):
    """Fill the contact points of a cube that may touch the ground within a step.

    Args:
        surface, ground, dt: see `resolve_ground_contacts`.
        centre, h, quaternion: centre [m], half edge [m] and attitude of the cube.
        height: vertical distance of the centre from the surface [m].
        nz: vertical component of the ground's normal.
        reach: maximum distance of a contact point from the ground [m].
        max_speed: maximum speed at which a point comes out of the ground [m/s].
        points: `ContactPoints`, out.

    Returns:
        Number of contact points.
    """
    x, y, z = centre
    count = 0
    for p in range(_NUM_CONTACT_POINTS):
        if p < _NUM_CORNERS:
            bx = h if p & 1 else -h
            by = h if p & 2 else -h
            bz = h if p & 4 else -h
            ax, ay, az = _rotate(quaternion, bx, by, bz)
            ground_height = surface_at(surface, ground[0], ground[1], ground[2], x + ax, y + ay)[0]
            gap = (z + az - ground_height) * nz
        else:
            ax, ay, az = 0.0, 0.0, -h
            gap = height - h
        if gap > reach:
            continue
        points.arm[count, 0], points.arm[count, 1], points.arm[count, 2] = ax, ay, az
        points.min_normal_speed[count] = (
            -gap / dt if gap >= 0.0 else min(-_RECOVERY_FRACTION * gap / dt, max_speed)
        )
        points.normal_impulse[count] = 0.0
        for axis in range(3):
            points.friction_impulse[count, axis] = 0.0
        count += 1
    return count


@helper(forceinline=True)
def _norm(vectors, i):  # type: ignore[no-untyped-def]
    """Return the norm of row i."""
    x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
    return np.sqrt(np.float64(x * x + y * y + z * z))


@helper(forceinline=True)
def _rotate(quaternion, x, y, z):  # type: ignore[no-untyped-def]
    """Rotate a vector from the axes of a cube, attitude x y z w, to map axes."""
    a, b, c, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    px, py, pz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (
        x + w * px + b * pz - c * py,
        y + w * py + c * px - a * pz,
        z + w * pz + a * py - b * px,
    )


@kernel
def finish_ground_contacts(  # type: ignore[no-untyped-def]
    surface, ground, dt, settle_speed, skip_ground, cubes, settle_timer
):
    """Put cubes that sank into the ground back on it, and advance the settle timers.

    A cube whose centre is more than half an edge below the surface is put on it, at rest. A cube is
    on the ground within half its diagonal, sqrt(3)/2 of its size: the rule of the reference
    (section 3.3.4).

    Args:
        surface, ground: contact surface [m] and `Ground.frame`.
        dt: [s].
        settle_speed: speed below which a cube is slow [m/s].
        skip_ground: cubes without ground contact, shape (n,).
        cubes: `CubeView`, updated.
        settle_timer: time for which each cube has been slow on the ground [s], updated.

    Returns:
        Number of cubes that were put back.
    """
    position, velocity = cubes.position, cubes.velocity
    num_recovered = 0
    for i in range(position.shape[0]):
        is_slow = _norm(velocity, i) < settle_speed
        if skip_ground[i] or not is_slow:
            settle_timer[i] = 0.0
        if skip_ground[i]:
            continue
        h = np.float64(cubes.half_edge[i])
        x, y = position[i, 0], position[i, 1]
        height = surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]
        slope_x, slope_y = _slopes(surface, ground, x, y, _SQRT3 * h)
        inverse_nz = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        distance = (position[i, 2] - height) / inverse_nz
        if distance < -h and not cubes.penetration_limited[i]:
            position[i, 2] = height + h * inverse_nz
            for axis in range(3):
                velocity[i, axis] = 0.0
                cubes.angular_velocity[i, axis] = 0.0
            num_recovered += 1
            distance = h
        if distance > _SQRT3 * h:
            settle_timer[i] = 0.0
        elif is_slow:
            settle_timer[i] += dt
    return num_recovered

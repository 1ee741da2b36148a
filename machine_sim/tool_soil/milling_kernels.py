"""Kernels of the picks of a drum; see `milling_resistance`.

What the picks do is a record of numbers, with the slots below.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.rotated_vectors import rotate_to_map
from machine_sim.tool_soil.capped_spring_damper import (
    ACTIVE_FRACTION,
    LOCAL_POINT,
    MAX_FORCE,
    reset_wrench,
    set_wrench,
    step_spring_damper,
)
from machine_sim.tool_soil.resistance import step_resistance
from msg_bridge.contract.rows import SoilReaction
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = [
    "DEBT",
    "MILLED",
    "NOT_MILLED",
    "PICK_FORCE",
    "WORK_STATE",
    "drum_wrench",
    "milling_record",
    "receive_milling",
    "step_picks",
]

DEBT, PICK_FORCE, LAST_SLIP, PRESSED_FORCE = range(4)
"""Debt of work [J], force on the picks in the last step [N], their velocity over the soil in it
[m/s], and force of picks that are pressed into the soil [N]."""

WORK_STATE = slice(0, 4)
"""Slots of the values above."""

_POINT, _ARM, _DIRECTION = 4, 7, 8
"""Picks that engage soil: first of three slots of where they do [m], relative to the origin of the
frame, map axes; lever arm about the axis [m]; first of three slots of the direction of their motion
when the drum spins with a positive speed, map axes."""

_WRENCH = 11
"""First of six slots of the wrench of the soil without the force on the picks [N], [N m]."""

_RADIUS, _PICK_ANGLE = 17, 18
"""Radius of the drum [m], and angle between two rows of picks [rad]."""

_NUM_SLOTS = 19

_THRUST_RATIO = 1.0
"""Ratio of the normal to the cutting force of a pick [-]: measured ratios of conical picks are
around one and increase with wear (see `soil_sim.tool_force.rock_pick`)."""

_MIN_LEVER_FRACTION = 0.3
"""Minimum lever arm of the picks as a fraction of the drum's radius: picks engage on its rim, but
the centre of the engaged soil can be on the axis."""

MILLED, NOT_MILLED = -1, -2
"""Answers of the soil to a drum that milled, and to one that did not."""

_MILL, _BEARING = int(SoilReaction.MILL), int(SoilReaction.BEARING)


def milling_record(radius: float, pick_angle: float) -> NDArray[np.float64]:
    """Return the record of picks that engage no soil.

    Args:
        radius: of the drum [m].
        pick_angle: angle between two rows of picks [rad].
    """
    record = np.zeros(_NUM_SLOTS)
    record[_RADIUS] = record[_ARM] = radius
    record[_PICK_ANGLE] = pick_angle
    return record


@kernel
def receive_milling(rows, rotation, origin, travel, record, contact):  # type: ignore[no-untyped-def]
    """Take the soil's answer to a tick of a drum.

    Args:
        rows: FORCE rows of the drum, shape (n,).
        rotation, origin: pose of its non-spinning frame at the end of that tick.
        travel: distance that the picks moved in that tick [m].
        record: of the picks; its debt is updated.
        contact: spring-damper of the soil in front of the drum; updated.

    Returns:
        `MILLED`; or `NOT_MILLED`, or the index of a row that is not valid, which change nothing.
    """
    mill_row, bearing_row = -1, -1
    for n in range(rows.size):
        if rows[n].reaction == _MILL and mill_row < 0:
            mill_row = n
        elif rows[n].reaction == _BEARING and bearing_row < 0:
            bearing_row = n
    if mill_row < 0:
        return NOT_MILLED
    work = np.float64(rows[mill_row].work)
    if not _is_finite(rows[mill_row]) or not (math.isfinite(work) and work >= 0.0):
        return mill_row
    if bearing_row >= 0 and not _is_finite(rows[bearing_row]):
        return bearing_row
    # The thrust on the picks is their force, work over distance, times a ratio.
    limit = _THRUST_RATIO * work / travel if travel > 0.0 else 0.0
    row = rows[mill_row]
    if bearing_row >= 0:
        row, limit = rows[bearing_row], math.inf
    record[DEBT] += work
    fx, fy, fz = np.float64(row.fx), np.float64(row.fy), np.float64(row.fz)
    strength = math.sqrt(fx * fx + fy * fy + fz * fz)
    limit = min(limit, strength)
    if limit <= 0.0:
        reset_wrench(contact)
        return MILLED
    fraction = limit / strength
    point = (np.float64(row.x), np.float64(row.y), np.float64(row.z))
    force = (fraction * fx, fraction * fy, fraction * fz)
    set_wrench(contact, point, force, (0.0, 0.0, 0.0), rotation, origin)
    return MILLED


@helper
def _is_finite(row):  # type: ignore[no-untyped-def]
    """Return whether point and force of a FORCE row are finite."""
    is_finite = True
    for value in (row.x, row.y, row.z, row.fx, row.fy, row.fz):
        is_finite &= math.isfinite(value)
    return is_finite


@fixed_signature_kernel
def step_picks(  # type: ignore[no-untyped-def]
    record,
    contact,
    spring_dampers,
    mean_push,
    is_static_active,
    rotation,
    velocity,
    dt,
    max_store,
):
    """Advance the picks by a physics step, all but the force on them, which `drum_wrench` sets.

    Args:
        record: of the picks; updated.
        contact: spring-damper of the soil in front of the drum; updated.
        spring_dampers, mean_push, is_static_active: of the resistance of a drum at rest; updated.
        rotation: of the non-spinning frame of the drum.
        velocity: of its origin [m/s], and angular of the drum [rad/s], map axes.
        dt: physics step [s].
        max_store: maximum work of the picks beyond the debt that is kept [J].

    Returns:
        Velocity of the picks over the soil [m/s], their lever arm [m], debt [J], and force of picks
        that are pressed into the soil [N].
    """
    ax, ay, az = axis = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    frame_velocity, (wx, wy, wz) = velocity
    spin = _dot(velocity[1], axis)
    frame_spin = (wx - spin * ax, wy - spin * ay, wz - spin * az)
    # The work of the step that has ended: force times the mean of the slips at its ends.
    slip = _slip(record, spin, frame_velocity, frame_spin)
    debt = record[DEBT] - record[PICK_FORCE] * 0.5 * abs(slip + record[LAST_SLIP]) * dt
    debt = max(debt, -max_store)
    (fx, fy, fz), (tx, ty, tz) = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if is_static_active:
        (fx, fy, fz), (tx, ty, tz) = step_resistance(
            spring_dampers, mean_push, rotation, frame_velocity, frame_spin, dt, (0.0, 0.0, 0.0)
        )
    contact_wrench = step_spring_damper(contact, rotation, frame_velocity, frame_spin, dt, math.inf)
    for k in range(6):
        record[_WRENCH + k] = (fx, fy, fz, tx, ty, tz)[k] + contact_wrench[k]
    point = rotate_to_map(
        rotation, contact[LOCAL_POINT], contact[LOCAL_POINT + 1], contact[LOCAL_POINT + 2]
    )
    _engage_at(record, point, axis)
    slip, arm = _slip(record, spin, frame_velocity, frame_spin), record[_ARM]
    target = contact[ACTIVE_FRACTION] * contact[MAX_FORCE] / _THRUST_RATIO
    travel = abs(slip) * dt / (arm * record[_PICK_ANGLE])
    rise = max(target - record[PRESSED_FORCE], 0.0) * min(travel, 1.0)
    pressed_force = min(record[PRESSED_FORCE] + rise, target)
    record[DEBT], record[LAST_SLIP], record[PRESSED_FORCE] = debt, slip, pressed_force
    return slip, arm, debt, pressed_force


@fixed_signature_kernel
def drum_wrench(record, rotation, pick_force):  # type: ignore[no-untyped-def]
    """Set the force on the picks in the next step [N], and return the wrench on the drum.

    Args:
        record: of the picks.
        rotation: of the non-spinning frame of the drum.
        pick_force: the force, against the slip.

    Returns:
        Force [N] and torque about the frame's origin [N m], map axes.
    """
    record[PICK_FORCE] = pick_force
    slip, arm, axis = (
        record[LAST_SLIP],
        record[_ARM],
        (rotation[0, 1], rotation[1, 1], rotation[2, 1]),
    )
    # The cutting force is against the slip. On a lever below the minimum arm it has less than its
    # torque; the rest is a pure torque.
    against_slip = -math.copysign(pick_force, slip)
    cx, cy, cz = (
        against_slip * record[_DIRECTION],
        against_slip * record[_DIRECTION + 1],
        against_slip * record[_DIRECTION + 2],
    )
    mx, my, mz = moment = _cross(_vector(record, _POINT), (cx, cy, cz))
    rest = -math.copysign(pick_force * arm, slip) - _dot(moment, axis)
    fx, fy, fz = _vector(record, _WRENCH)
    tx, ty, tz = _vector(record, _WRENCH + 3)
    return (
        (fx + cx, fy + cy, fz + cz),
        (tx + mx + rest * axis[0], ty + my + rest * axis[1], tz + mz + rest * axis[2]),
    )


@helper
def _engage_at(record, point, axis):  # type: ignore[no-untyped-def]
    """Set the picks to those at a point [m] of a drum with an axis."""
    along = _dot(point, axis)
    (x, y, z), (ax, ay, az) = point, axis
    lever = (x - along * ax, y - along * ay, z - along * az)
    distance = math.sqrt(_dot(lever, lever))
    record[_ARM] = max(distance, _MIN_LEVER_FRACTION * record[_RADIUS])
    direction = _cross(axis, lever)
    for k in range(3):
        record[_POINT + k] = point[k]
        record[_DIRECTION + k] = direction[k] / distance if distance > 0.0 else 0.0


@helper
def _slip(record, spin, frame_velocity, frame_spin):  # type: ignore[no-untyped-def]
    """Return the velocity of the picks over the soil [m/s].

    Args:
        record: of the picks.
        spin: angular velocity of the drum about its axis [rad/s].
        frame_velocity, frame_spin: of its non-spinning frame: of the origin [m/s], angular [rad/s].
    """
    (vx, vy, vz), (wx, wy, wz) = frame_velocity, _cross(frame_spin, _vector(record, _POINT))
    return spin * record[_ARM] + _dot((vx + wx, vy + wy, vz + wz), _vector(record, _DIRECTION))


@helper
def _vector(record, slot):  # type: ignore[no-untyped-def]
    """Return three numbers of a record from a slot on."""
    return record[slot], record[slot + 1], record[slot + 2]


@helper
def _dot(a, b):  # type: ignore[no-untyped-def]
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def _cross(a, b):  # type: ignore[no-untyped-def]
    """Return the cross product."""
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx

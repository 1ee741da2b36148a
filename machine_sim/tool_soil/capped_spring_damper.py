"""Capped spring-damper: a wrench of the soil that resists motion and never drives it.

Rigid-plastic soil resists with a force F up to its strength. It is modelled, like the contact of
the tracks' shoes (`machine_sim.machine.tracks.terramechanics`), by a spring and a damper along the
direction of the force:

    f F = k x + c v,    0 <= f <= 1,

where v is the speed of the contact point against F, x its displacement against F since the soil
yielded last, and f the active fraction. While the soil yields, f is 1 and x stays at its limit. A
tool that the machine cannot push further stalls: the soil carries just the force of the machine.
Motion away from the soil unloads it. A force that changed with the sign of v would make the arm
oscillate at every step instead.

A spring-damper is a record of numbers, with the slots below, which kernels advance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.rotated_vectors import rotate_to_frame, rotate_to_map
from msg_bridge.kernels import helper

__all__ = [
    "ACTIVE_FRACTION",
    "DISPLACEMENT",
    "FORCE",
    "LOCAL_POINT",
    "MAX_FORCE",
    "STATE",
    "distance_to_contact",
    "reset_wrench",
    "set_wrench",
    "spring_damper_record",
    "step_spring_damper",
]

FORCE, TORQUE = 0, 3
"""First of three slots of the maximum force [N], map axes, and of its torque about the contact
point [N m]."""

CONTACT_POINT, LOCAL_POINT = 6, 9
"""First of three slots of the contact point when the wrench was set [m], map frame, and in the tool
frame; `reset_wrench` leaves the latter."""

DISPLACEMENT = 12
"""Displacement of the contact point against the force since the soil yielded last [m]."""

STATE = slice(0, 13)
"""Slots of all values that the next steps depend on."""

MAX_FORCE, ACTIVE_FRACTION = 13, 14
"""Norm of the maximum force [N], 0 without a wrench, and the fraction of it that acts, 0 to 1."""

_STIFFNESS, _DAMPING, _SLACK = 15, 16, 17
"""Spring [N/m], damper [N s/m], and the distance [m] by which the point may move back before the
soil's position moves back with it."""

_NUM_SLOTS = 18


def spring_damper_record(stiffness: float, damping: float, slack: float) -> NDArray[np.float64]:
    """Return the record of a spring-damper without a wrench.

    Args:
        stiffness: of the spring [N/m].
        damping: of the damper [N s/m].
        slack: distance [m] by which the point may move back before the soil's position moves back
            with it.
    """
    record = np.zeros(_NUM_SLOTS)
    record[_STIFFNESS], record[_DAMPING], record[_SLACK] = stiffness, damping, slack
    return record


@helper
def reset_wrench(record):  # type: ignore[no-untyped-def]
    """Remove the wrench of a spring-damper, if there is one."""
    if record[MAX_FORCE] > 0.0:
        for k in range(LOCAL_POINT):
            record[k] = 0.0
        record[DISPLACEMENT] = record[MAX_FORCE] = record[ACTIVE_FRACTION] = 0.0


@helper
def set_wrench(record, point, force, torque, rotation, origin):  # type: ignore[no-untyped-def]
    """Replace the wrench of a spring-damper.

    Args:
        record: of the spring-damper.
        point, force, torque: contact point [m], force [N] and torque [N m] of the soil on the tool,
            map frame, three numbers each; the force is not zero.
        rotation, origin: pose of the tool frame when the contact point was there.
    """
    for k in range(3):
        record[FORCE + k], record[TORQUE + k] = force[k], torque[k]
        record[CONTACT_POINT + k] = point[k]
    record[MAX_FORCE] = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    record[LOCAL_POINT], record[LOCAL_POINT + 1], record[LOCAL_POINT + 2] = rotate_to_frame(
        rotation, point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    )


@helper
def distance_to_contact(record, rotation, origin):  # type: ignore[no-untyped-def]
    """Return the distance [m] of the tool's contact point from where the wrench was set.

    Args:
        record: of the spring-damper.
        rotation, origin: pose of the tool frame.
    """
    ax, ay, az = _lever_arm(record, rotation)
    x = ax + origin[0] - record[CONTACT_POINT]
    y = ay + origin[1] - record[CONTACT_POINT + 1]
    z = az + origin[2] - record[CONTACT_POINT + 2]
    return math.sqrt(x * x + y * y + z * z)


@helper
def step_spring_damper(record, rotation, velocity, angular_velocity, dt, limit):  # type: ignore[no-untyped-def]
    """Return the wrench that acts in the next step: fx, fy, fz [N], tx, ty, tz [N m].

    Args:
        record: of the spring-damper; displacement and active fraction are updated.
        rotation: of the tool frame.
        velocity, angular_velocity: of the origin of the tool frame [m/s], [rad/s], map axes.
        dt: physics step [s].
        limit: largest force in this step [N], if below the maximum force.

    Returns:
        Force, and torque about the tool frame's origin, map axes.
    """
    max_force = record[MAX_FORCE]
    if max_force == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ax, ay, az = _lever_arm(record, rotation)
    (vx, vy, vz), (wx, wy, wz) = velocity, angular_velocity
    fx, fy, fz = record[FORCE], record[FORCE + 1], record[FORCE + 2]
    # The velocity of the contact point is v + w x a.
    vx, vy, vz = vx + (wy * az - wz * ay), vy + (wz * ax - wx * az), vz + (wx * ay - wy * ax)
    speed = -(vx * fx + vy * fy + vz * fz) / max_force
    displacement = record[DISPLACEMENT] + speed * dt
    uncapped = record[_STIFFNESS] * displacement + record[_DAMPING] * speed
    active_force = min(max(uncapped, 0.0), max_force, limit)
    if active_force == 0.0:  # the tool moves away from the soil
        displacement = min(max(displacement, -record[_SLACK]), 0.0)
    elif active_force != uncapped:  # the soil yields: the spring starts from here
        displacement = min(displacement, active_force / record[_STIFFNESS])
    active_fraction = active_force / max_force
    record[DISPLACEMENT], record[ACTIVE_FRACTION] = displacement, active_fraction
    fx, fy, fz = active_fraction * fx, active_fraction * fy, active_fraction * fz
    tx = active_fraction * record[TORQUE] + (ay * fz - az * fy)
    ty = active_fraction * record[TORQUE + 1] + (az * fx - ax * fz)
    tz = active_fraction * record[TORQUE + 2] + (ax * fy - ay * fx)
    return fx, fy, fz, tx, ty, tz


@helper
def _lever_arm(record, rotation):  # type: ignore[no-untyped-def]
    """Return the contact point relative to the origin of the tool frame [m], map axes."""
    return rotate_to_map(
        rotation, record[LOCAL_POINT], record[LOCAL_POINT + 1], record[LOCAL_POINT + 2]
    )

"""Kernel of the kinematic tracks: places the shoes on their path and advances the belts.

It advances the actuators of the machine first, which command the belts. Then:

1. Place each shoe on the path of its belt. It touches the ground at its middle; the shoe that is
   below an axle touches it there, so that the track ends at its axles wherever the shoes are.
2. Find the ground's force on both contact points of the shoes that face the ground.
3. Advance the speed of each belt by its drive and the ground's force on it.
4. Add the ground's force on the main body.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.actuator_step import advance_actuators
from machine_sim.machine.tracks.body_contact import MainBody, add_body_contact
from machine_sim.machine.tracks.rigid_body import (
    add_wrench,
    base_frame,
    dot,
    point_velocity,
    to_map,
)
from machine_sim.machine.tracks.shoe_contact import (
    CONTACT_WIDTH_FRACTION,
    MAX_OUTWARD_Z,
    mean_depth,
    sole_force,
)
from machine_sim.machine.tracks.terramechanics import SoilPatch
from machine_sim.machine.tracks.track_slip import update_mean_speeds
from machine_sim.machine.tracks.track_state import (
    SHOE_PITCH,
    SHOE_X,
    SHOE_Z,
    BeltDrive,
    ContactCoefficients,
    ContactPoints,
    TrackDimensions,
    TrackState,
)
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = ["POINTS_PER_SHOE", "KinematicTables", "kinematic_track_step"]

Array = NDArray[np.float64]

POINTS_PER_SHOE = 2
"""Contact points of a shoe: one near each end."""

_FIRST_LOWER_RUN, _UPPER_RUN, _SECOND_LOWER_RUN = (
    (math.cos(pitch), -math.sin(pitch)) for pitch in (math.pi, 2.0 * math.pi, 3.0 * math.pi)
)
"""Directions of motion (x, z) of the shoes on straight parts of the path, axle frame. They are
rounded as on the arcs, so that a shoe does not turn where an arc ends."""


class KinematicTables(NamedTuple):
    """Parameters and state of a pair of kinematic tracks.

    Attributes:
        dimensions, drive: dimensions, and drive of one belt.
        coefficients: coefficients of one contact point.
        axle_coefficients: those of a contact point below an axle.
        soil: soil under the shoes.
        points: contact points of the shoes, `POINTS_PER_SHOE` each, left track first.
        body: main body.
        command: commanded belt speeds left, right [m/s], shape (2,).
        state: state of the tracks.
    """

    dimensions: TrackDimensions
    drive: BeltDrive
    coefficients: ContactCoefficients
    axle_coefficients: ContactCoefficients
    soil: SoilPatch
    points: ContactPoints
    body: MainBody
    command: Array
    state: TrackState


@fixed_signature_kernel
def kinematic_track_step(dt, motion, swing_cos, swing_sin, actuators, boxed):  # type: ignore[no-untyped-def]
    """Advance actuators and both belts by one time step, and find the ground's wrench.

    Args:
        dt: time step [s].
        motion: packed motion of the base, see `base_motion`.
        swing_cos, swing_sin: cosine and sine of the angle of the main body's joint.
        actuators: boxed `ActuatorTables`, which set the commanded belt speeds.
        boxed: boxed `KinematicTables`; the state, the contact points and the maximum sinkage of
            the soil are updated.
    """
    advance_actuators(dt, actuators.table)
    tables = boxed.table
    dimensions, coefficients, state = tables.dimensions, tables.coefficients, tables.state
    base = base_frame(motion)
    length = 4.0 * dimensions.half_axle_distance + 2.0 * math.pi * dimensions.sprocket_radius
    state.wrench[:] = 0.0
    for side in range(2):
        y_track = dimensions.half_gauge if side == 0 else -dimensions.half_gauge
        belt_force = _shoe_forces(
            side,
            y_track,
            length,
            base,
            dimensions,
            coefficients,
            tables.axle_coefficients,
            tables.soil,
            tables.points,
            state,
        )
        state.speed[side], state.drive_forces[side] = _driven_belt(
            dt, state.speed[side], tables.command[side], belt_force, tables.drive
        )
        update_mean_speeds(
            state.mean_speeds, side, dt, state.speed[side], base, dimensions.base_com, y_track
        )
        state.travel[side] = (state.travel[side] + state.speed[side] * dt) % length
    swing = (swing_cos, swing_sin)
    add_body_contact(base, swing, dimensions.base_com, tables.body, coefficients, state.wrench)


@helper(forceinline=True)
def _shoe_forces(  # type: ignore[no-untyped-def]
    side,
    y_track,
    length,
    base,
    dimensions,
    coefficients,
    axle_coefficients,
    soil,
    points,
    state,
):
    """Place the shoes of a belt and add the ground's forces on them to the wrench.

    Returns:
        Force of the ground on the belt in its direction of motion [N].
    """
    count = state.shoe_poses.shape[1]
    half_thickness = dimensions.half_thickness
    area = length / count * dimensions.half_width  # of one contact point
    com_x, com_y, com_z = dimensions.base_com
    (r00, _, r02), (r10, _, r12), (r20, _, r22) = base.rotation
    belt_force, total_load, load_depth = 0.0, 0.0, 0.0
    for k in range(count):
        s = state.travel[side] + k * length / count
        if s >= length:  # both are at most once round the path; faster than a modulo, and as exact
            s -= length
        x, z, pitch, is_on_arc, (tx, tz) = _belt_path_pose(
            s, dimensions.half_axle_distance, dimensions.sprocket_radius
        )
        state.shoe_poses[side, k, SHOE_X] = x
        state.shoe_poses[side, k, SHOE_Z] = z + dimensions.axle_height
        state.shoe_poses[side, k, SHOE_PITCH] = pitch
        state.shoe_loads[side, k] = 0.0
        ahead = _distance_to_axle(s, length, dimensions.half_axle_distance)
        point_coefficients = axle_coefficients
        if abs(ahead) > 0.5 * length / count:
            ahead, point_coefficients = 0.0, coefficients
        else:
            x, z, _, is_on_arc, (tx, tz) = _belt_path_pose(
                (s + ahead) % length, dimensions.half_axle_distance, dimensions.sprocket_radius
            )
        # The direction of motion is (tx, tz); (-tz, tx) is outward.
        first = (side * count + k) * POINTS_PER_SHOE
        if -r20 * tz + r22 * tx > MAX_OUTWARD_Z:
            points.is_active[first] = False
            points.is_active[first + 1] = False
            continue
        local_x = x - tz * half_thickness - com_x
        local_z = z + tx * half_thickness + dimensions.axle_height - com_z
        # On an arc the outside of a shoe is faster than the pitch line.
        sole_speed = state.speed[side] * (
            1.0 + is_on_arc * half_thickness / dimensions.sprocket_radius
        )
        tangent = (r00 * tx + r02 * tz, r10 * tx + r12 * tz, r20 * tx + r22 * tz)
        for end in range(POINTS_PER_SHOE):
            offset = (1.0 - 2.0 * end) * CONTACT_WIDTH_FRACTION * dimensions.half_width
            arm = to_map(base.rotation, (local_x, y_track + offset - com_y, local_z))
            (cx, cy, cz), (ax, ay, az) = base.center_of_mass, arm
            vx, vy, vz = point_velocity(base.velocity, base.angular_velocity, arm)
            velocity = (
                vx + tangent[0] * sole_speed,
                vy + tangent[1] * sole_speed,
                vz + tangent[2] * sole_speed,
            )
            contact = (cx + ax, cy + ay, cz + az)
            middle = (
                contact[0] - ahead * tangent[0],
                contact[1] - ahead * tangent[1],
                contact[2] - ahead * tangent[2],
            )
            force, load, depth = sole_force(
                contact, middle, velocity, point_coefficients, area, soil, points, first + end
            )
            if load > 0.0:
                state.shoe_loads[side, k] += load
                total_load += load
                load_depth += load * depth
                belt_force += dot(force, tangent)
                add_wrench(state.wrench, force, arm)
    state.sinkage[side] = mean_depth(load_depth, total_load)
    return belt_force


@helper(forceinline=True)
def _distance_to_axle(s, length, half):  # type: ignore[no-untyped-def]
    """Return the distance along the path to the nearest end of the lower run [m].

    Args:
        s, length, half: as for `_belt_path_pose`, and the length of the path [m].
    """
    if s < 0.5 * length:
        return half - s
    return length - half - s


@helper(forceinline=True)
def _belt_path_pose(s, half, radius):  # type: ignore[no-untyped-def]
    """Return the pose of a shoe in the axle frame.

    The path begins below the middle. The lower run goes backward, then the path goes round the rear
    sprocket, forward on the upper run and down in front.

    Args:
        s: arc length from the beginning of the path [m].
        half: half the axle distance [m].
        radius: radius of the pitch line at the wheels [m].

    Returns:
        x, z [m], pitch [rad], 1.0 if the shoe is on an arc, else 0.0, and its direction of motion.
    """
    arc = math.pi * radius
    if s < half:
        return -s, -radius, math.pi, 0.0, _FIRST_LOWER_RUN
    s -= half
    if s < arc:
        a = s / radius
        pitch = math.pi + a
        x, z = -half - radius * math.sin(a), -radius * math.cos(a)
        return x, z, pitch, 1.0, (math.cos(pitch), -math.sin(pitch))
    s -= arc
    if s < 2.0 * half:
        return -half + s, radius, 2.0 * math.pi, 0.0, _UPPER_RUN
    s -= 2.0 * half
    if s < arc:
        a = s / radius
        pitch = 2.0 * math.pi + a
        x, z = half + radius * math.sin(a), radius * math.cos(a)
        return x, z, pitch, 1.0, (math.cos(pitch), -math.sin(pitch))
    return half - (s - arc), -radius, 3.0 * math.pi, 0.0, _SECOND_LOWER_RUN


@helper(forceinline=True)
def _driven_belt(dt, speed, command, belt_force, drive):  # type: ignore[no-untyped-def]
    """Return the speed of a belt after one time step [m/s], and the force of its drive [N].

    The drive compensates the ground's force and accelerates the belt toward the command, as far as
    its tractive effort allows.

    Args:
        dt: time step [s].
        speed, command: present and commanded speed [m/s].
        belt_force: force of the ground on the belt [N].
        drive: `BeltDrive`.
    """
    is_braking = command * speed <= 0.0 or abs(command) < abs(speed)
    max_change = (drive.max_deceleration if is_braking else drive.max_acceleration) * dt
    change = min(max(command - speed, -max_change), max_change)
    max_effort = drive.max_tractive_effort
    effort = min(max(drive.belt_mass * change / dt - belt_force, -max_effort), max_effort)
    if abs(effort) < max_effort:
        return speed + change, effort  # exact, so that a belt commanded to stop reaches zero
    return speed + (effort + belt_force) / drive.belt_mass * dt, effort

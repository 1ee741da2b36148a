"""Locked loads: soil that is locked to a tool and moves with it as one rigid body."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.pose import (
    ANGULAR,
    LINEAR,
    ORIGIN,
    rotate_to_map_axes,
    velocity_at,
)
from machine_sim.dem.vec3 import cross
from msg_bridge.kernels import helper

__all__ = ["move_locked_loads"]


@helper
def move_locked_loads(standard, locked_rows, tool_of_row, particles, tools, acceleration):  # type: ignore[no-untyped-def]
    """Move locked particles to the end poses of their tools; add their weight and inertia to the
    wrenches.

    Args:
        standard: acceleration of gravity, downward [m/s^2].
        locked_rows, tool_of_row: locked rows, and the tool index of each.
        particles: `ParticleColumns`; the motion is updated.
        tools: `ToolMotion` of a step that has begun; the wrenches are updated.
        acceleration: of each tool, see `GravityInTools`.
    """
    substeps, num_tools = tools.path.shape[0] - 1, tools.path.shape[1]
    for t in range(num_tools):
        load, centre = _move_locked_load(
            t, locked_rows, tool_of_row, tools.path[substeps, t], tools.twist[t], particles
        )
        if load == 0.0:
            continue
        force = (
            load * (0.0 - acceleration[t, 0]),
            load * (0.0 - acceleration[t, 1]),
            load * (-standard - acceleration[t, 2]),
        )
        torque = cross(centre, force)
        for axis in range(3):
            # The wrench is a sum over the substeps until `end_step` divides it.
            tools.wrench[t, LINEAR + axis] += force[axis] * substeps
            tools.wrench[t, ANGULAR + axis] += torque[axis] * substeps


@helper
def _move_locked_load(tool, locked_rows, tool_of_row, pose, twist, particles):  # type: ignore[no-untyped-def]
    """Move the particles that are locked to a tool to its pose.

    The wake reference of a locked particle is its position in the tool frame.

    Args:
        tool: index of the tool.
        locked_rows, tool_of_row: locked rows of all tools, and the tool index of each.
        pose, twist: packed pose and twist of the tool.
        particles: `ParticleColumns`; the motion is updated.

    Returns:
        Mass of the load [kg], 0 if there is none, and its centre of mass relative to the origin of
        the tool's frame [m], map axes.
    """
    load = moment_x = moment_y = moment_z = 0.0
    for k in range(locked_rows.size):
        if tool_of_row[k] != tool:
            continue
        i = locked_rows[k]
        reference = particles.wake_reference[i]
        x, y, z = rotate_to_map_axes(pose, reference[0], reference[1], reference[2])
        particles.position[i, 0] = pose[ORIGIN] + x
        particles.position[i, 1] = pose[ORIGIN + 1] + y
        particles.position[i, 2] = pose[ORIGIN + 2] + z
        vx, vy, vz = velocity_at(twist, x, y, z)
        particles.velocity[i, 0], particles.velocity[i, 1] = vx, vy
        particles.velocity[i, 2] = vz
        for axis in range(3):
            particles.angular_velocity[i, axis] = twist[ANGULAR + axis]
        m = np.float64(particles.mass[i])
        load += m
        moment_x += m * x
        moment_y += m * y
        moment_z += m * z
    if load == 0.0:
        return load, (0.0, 0.0, 0.0)
    return load, (moment_x / load, moment_y / load, moment_z / load)

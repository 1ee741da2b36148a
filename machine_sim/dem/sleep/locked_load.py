"""Locked load: soil that is locked to a tool and moves with it as one rigid body."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.pose import ANGULAR, ORIGIN, rotate_to_map_axes, velocity_at
from msg_bridge.kernels import kernel

__all__ = ["move_locked_load"]


@kernel
def move_locked_load(tool, locked_rows, tool_of_row, pose, twist, mass, view):  # type: ignore[no-untyped-def]
    """Move the particles that are locked to a tool to its pose.

    Args:
        tool: index of the tool, one that has a locked load.
        locked_rows, tool_of_row: locked rows of all tools, and the tool index of each.
        pose, twist: packed pose and twist of the tool.
        mass: of all particles [kg].
        view: `SleepView`; the motion is updated. The wake reference of a locked particle is its
            position in the tool frame.

    Returns:
        Mass of the load [kg], and its centre of mass relative to the origin of the tool's frame
        [m], map axes, shape (3,).
    """
    load, moment = 0.0, np.zeros(3)
    for k in range(locked_rows.size):
        if tool_of_row[k] != tool:
            continue
        i = locked_rows[k]
        x, y, z = rotate_to_map_axes(
            pose, view.wake_reference[i, 0], view.wake_reference[i, 1], view.wake_reference[i, 2]
        )
        view.position[i, 0] = pose[ORIGIN] + x
        view.position[i, 1] = pose[ORIGIN + 1] + y
        view.position[i, 2] = pose[ORIGIN + 2] + z
        vx, vy, vz = velocity_at(twist, x, y, z)
        view.velocity[i, 0], view.velocity[i, 1], view.velocity[i, 2] = vx, vy, vz
        for axis in range(3):
            view.angular_velocity[i, axis] = twist[ANGULAR + axis]
        m = np.float64(mass[i])
        load += m
        moment[0] += m * x
        moment[1] += m * y
        moment[2] += m * z
    return load, moment / load

"""Sleep timers: how long each awake particle has hardly moved relative to its carrier."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.pose import ANGULAR, ORIGIN, velocity_at
from msg_bridge.kernels import helper

__all__ = ["update_sleep_timers"]


@helper
def update_sleep_timers(  # type: ignore[no-untyped-def]
    rows, inside, view, pose, twist, sleep_speed, sleep_time, dt, sleep_ready
):
    """Advance the timers of awake particles, and mark those that may fall asleep.

    A particle is slow where the speed of its centre and of its surface, v^2 + (w r)^2, relative to
    the tool it is in or else to the map, is at most `sleep_speed`. One that still grows is not.

    Args:
        rows: awake rows.
        inside: tool index of each of `rows`, `NO_TOOL` for none.
        view: `ParticleColumns`; the timers are updated.
        pose, twist: packed poses at the end of the step, and twists, of the tools.
        sleep_speed: [m/s].
        sleep_time: how long a particle must be slow [s].
        dt: [s].
        sleep_ready: out, which of `rows` have been slow for that long.

    Returns:
        Number of those.
    """
    num_ready = 0
    position, velocity, angular_velocity = view.position, view.velocity, view.angular_velocity
    sleep_timer, radius, contact_radius = view.sleep_timer, view.radius, view.contact_radius
    for k in range(rows.size):
        i, t = np.uint64(rows[k]), inside[k]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx = np.float64(angular_velocity[i, 0])
        wy = np.float64(angular_velocity[i, 1])
        wz = np.float64(angular_velocity[i, 2])
        if t >= 0:
            qx = position[i, 0] - pose[t, ORIGIN]
            qy = position[i, 1] - pose[t, ORIGIN + 1]
            qz = position[i, 2] - pose[t, ORIGIN + 2]
            ux, uy, uz = velocity_at(twist[t], qx, qy, qz)
            vx, vy, vz = vx - ux, vy - uy, vz - uz
            wx -= twist[t, ANGULAR]
            wy -= twist[t, ANGULAR + 1]
            wz -= twist[t, ANGULAR + 2]
        r = np.float64(radius[i])
        speed2 = vx * vx + vy * vy + vz * vz + r * r * (wx * wx + wy * wy + wz * wz)
        if speed2 > sleep_speed * sleep_speed or contact_radius[i] < radius[i]:
            sleep_timer[i] = np.float32(0.0)
        else:
            sleep_timer[i] += np.float32(dt)
            sleep_ready[k] = sleep_timer[i] >= sleep_time
            num_ready += sleep_ready[k]
    return num_ready

"""Slip of the tracks, from moving averages of the speeds of belts and ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.tracks.track_state import BELT_SPEED, GROUND_SPEED
from msg_bridge.kernels import helper

__all__ = ["track_slip", "update_mean_speeds"]

Array = NDArray[np.float64]

_MEAN_SPEED_TIME = 0.5
"""Averaging time of the speeds [s]; the chain of dynamic tracks does not run steadily."""

_STANDSTILL_SPEED = 0.01
"""Speed below which a belt or a side counts as standing [m/s]."""


def track_slip(mean_speeds: Array) -> Array:
    """Return the slip of each track, shape (2,).

    It is the difference between the speeds of belt and ground as a fraction of the larger one: 1
    for a track that spins on the spot, -1 for a locked track that is dragged. It is 0 where both
    are slower than 1 cm/s.

    Args:
        mean_speeds: `TrackState.mean_speeds`.
    """
    belt, ground = mean_speeds[:, BELT_SPEED], mean_speeds[:, GROUND_SPEED]
    faster = np.maximum(np.abs(belt), np.abs(ground))
    excess = (belt - ground) * np.sign(np.where(np.abs(belt) < _STANDSTILL_SPEED, ground, belt))
    slip = np.where(
        faster < _STANDSTILL_SPEED,
        0.0,
        np.clip(excess / np.maximum(faster, _STANDSTILL_SPEED), -1.0, 1.0),
    )
    return np.asarray(slip, dtype=np.float64)


@helper(forceinline=True)
def update_mean_speeds(mean_speeds, side, dt, belt_speed, base, base_com, y_track):  # type: ignore[no-untyped-def]
    """Update the moving averages of the speeds of a belt and of its side over the ground.

    Args:
        mean_speeds: `TrackState.mean_speeds`; the row of the side is updated.
        side: index of the side.
        dt: time step [s].
        belt_speed: present speed of the belt [m/s].
        base: `BaseFrame`.
        base_com: centre of mass of the base [m], base frame.
        y_track: y of the middle of the track [m], base frame.
    """
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = base.rotation
    (vx, vy, vz), (wx, wy, wz) = base.velocity, base.angular_velocity
    up, left = base_com[2], y_track - base_com[1]
    ground_speed = (
        (vx * r00 - wx * (r01 * up + r02 * left))
        + (vy * r10 - wy * (r11 * up + r12 * left))
        + (vz * r20 - wz * (r21 * up + r22 * left))
    )
    weight = min(dt / _MEAN_SPEED_TIME, 1.0)
    mean_speeds[side, BELT_SPEED] += weight * (belt_speed - mean_speeds[side, BELT_SPEED])
    mean_speeds[side, GROUND_SPEED] += weight * (ground_speed - mean_speeds[side, GROUND_SPEED])

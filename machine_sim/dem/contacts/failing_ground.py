"""Velocity of the ground that fails ahead of a cutting edge.

The soil that a blade or a bucket pushes against does not stand still: it fails along a plane that
rises from the edge, at 45 degrees less half the angle of internal friction to the horizontal
(passive failure: McKyes, Soil Cutting and Tillage, 1985, section 3.2), and slides up on it. The
particles between the tool and the face that it cuts are carried with it. On a face at rest they
would be pressed down by friction as the tool pushes them up along it, and brake the tool by the
damping of their contacts.

The face beside a particle moves as fast as the tool moves into it: as the wedge ahead of a blade of
75 degrees does. Level ground does not move, and none does behind a tool, below it, or beside a
drum, which mills the ground.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper

__all__ = ["failing_ground_velocity"]

_FAILURE_ANGLE = math.radians(30.0)
"""Angle of the failure plane to the horizontal, of soil with an internal friction of 30 degrees."""

_FORWARD, _UPWARD = math.cos(_FAILURE_ANGLE), math.sin(_FAILURE_ANGLE)


@helper(forceinline=True)
def failing_ground_velocity(normal, tool_velocity):  # type: ignore[no-untyped-def]
    """Return the velocity of the ground at a contact [m/s], map axes.

    Args:
        normal: unit normal of the ground, upward, map axes.
        tool_velocity: velocity of the tool at the contact [m/s], map axes.
    """
    nx, ny, _ = normal
    speed = -(nx * tool_velocity[0] + ny * tool_velocity[1])
    if speed <= 0.0:
        return 0.0, 0.0, 0.0
    forward = -speed * _FORWARD / math.sqrt(nx * nx + ny * ny)
    return forward * nx, forward * ny, speed * _UPWARD

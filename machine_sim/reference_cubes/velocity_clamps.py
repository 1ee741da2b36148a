"""Velocity clamps of the 2014 reference: they keep cubes in the bucket and let them drop.

"Real-Time Simulation of Moving Soil and Machinery" (2014) does without cohesion: in every physics
update of 5 ms (section 4.2) it overwrites the velocities of its cubes.

- Picking up and holding (3.2.2, 3.3.3, 4.3): a cube that moves up is made to move down, "instead of
  being thrown up when the movement of the bucket is slowing down".
- Pouring (3.3.4, `drop`): horizontal velocity is divided by LEVEL_VEL_CONS = 1.1, "more like dirt
  than ice balls"; upward velocity becomes DOWNWARD_VEL_CONS = -10 m/s.

Here upward and horizontal velocity are relative to the carrier of the cube. The reference clamps
velocities relative to the world, which has no consequences where cubes do not act on the machine.
Here their load does, and a bucket that lifts would have to accelerate every cube again in each
step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.reference_cubes.tool_proximity import ToolProximity

__all__ = ["REFERENCE_CLAMPS", "VelocityClamps", "clamp_velocities"]

_REFERENCE_TIME_STEP = 0.005
"""Time between two updates of the reference [s], section 4.2."""


@dataclass(frozen=True)
class VelocityClamps:
    """Parameters of the velocity clamps.

    Attributes:
        upward: vertical velocity, relative to its carrier, of a cube that rises [m/s]; 0 or less.
        horizontal_divisor: divisor of the horizontal velocity per 5 ms, in a tool and out of reach
            of all; 1 leaves it unchanged.
        enabled: whether velocities are clamped at all.
    """

    upward: float = 0.0
    horizontal_divisor: float = 1.1
    enabled: bool = True


REFERENCE_CLAMPS = VelocityClamps(upward=-10.0)
"""Clamps with the reference's own constant. A cube at rest vibrates; whenever it moves upward, the
next step drives it 5 cm into what it lies on. A load then weighs several times its weight, and soon
tunnels through plates of 2 cm."""


def clamp_velocities(
    clamps: VelocityClamps,
    dt: float,
    proximity: ToolProximity,
    frozen: NDArray[np.bool_],
    velocity: NDArray[np.float64],
) -> None:
    """Overwrite velocities as the reference does.

    The carrier of a cube inside a tool is the tool. A cube near a tool, on it or ahead of it, may
    rise as fast as the tool does and keeps its horizontal velocity. A cube out of reach of all
    tools has no carrier.

    Args:
        clamps: parameters.
        dt: [s].
        proximity: relation of the cubes to the tools.
        frozen: cubes that are left unchanged, shape (n,).
        velocity: [m/s], map frame, shape (n, 3), updated.
    """
    if not clamps.enabled:
        return
    inside, is_near = proximity.inside, proximity.in_reach & ~proximity.inside
    carrier = np.where(inside[:, None], proximity.velocity, 0.0)
    max_upward = np.where(is_near, np.maximum(proximity.velocity[:, 2], 0.0), carrier[:, 2])
    rises = (velocity[:, 2] > max_upward) & ~frozen
    velocity[rises, 2] = max_upward[rises] + clamps.upward
    is_damped = ~is_near & ~frozen
    factor = clamps.horizontal_divisor ** (-dt / _REFERENCE_TIME_STEP)
    relative = velocity[is_damped, :2] - carrier[is_damped, :2]
    velocity[is_damped, :2] = carrier[is_damped, :2] + factor * relative

"""Velocity constraints of the 2014 reference: they keep cubes in the bucket and let them drop.

"Real-Time Simulation of Moving Soil and Machinery" (2014) does without cohesion: in every physics
update of 5 ms (section 4.2) it overwrites the velocities of its cubes.

- Picking up and holding (3.2.2, 3.3.3, 4.3): a cube that moves up is made to move down, "instead of
  being thrown up when the movement of the bucket is slowing down".
- Pouring (3.3.4, `drop`): level velocity is divided by LEVEL_VEL_CONS = 1.1, "more like dirt than
  ice balls"; upward velocity becomes DOWNWARD_VEL_CONS = -10 m/s.

Here "up" and "level" are meant relative to what carries the cube. The reference clamps in the
world, which does no harm where nothing feels the cubes; here their load acts on the machine, and a
bucket that lifts would have to bring every cube up to speed anew in every step.
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
    """What becomes of the velocities of cubes before every step.

    Attributes:
        upward: vertical velocity given to a cube that rises from what carries it [m/s]; 0 or less.
        horizontal_divisor: what level velocity is divided by per 5 ms, in a tool and away from all;
            1 does nothing.
        act: False leaves all velocities alone.
    """

    upward: float = 0.0
    horizontal_divisor: float = 1.1
    enabled: bool = True


REFERENCE_CLAMPS = VelocityClamps(upward=-10.0)
"""The reference's own constant. A cube at rest trembles, and whenever that is upward the next step
drives it 5 cm into what it lies on: a load weighs several times what it should, and soon is through
plates of 2 cm."""


def clamp_velocities(
    clamps: VelocityClamps,
    dt: float,
    proximity: ToolProximity,
    frozen: NDArray[np.bool_],
    velocity: NDArray[np.float64],
) -> None:
    """Overwrite velocities as the reference does.

    A cube inside a tool is carried by it. One beside a tool, heaped on it or in its way, may rise
    as fast as the tool does and keeps its level velocity. One away from tools is carried by
    nothing.

    Args:
        clamps: how.
        dt: [s].
        around: the tools.
        frozen: who is left alone, shape (n,).
        velocity: [m/s], map frame, shape (n, 3), changed.
    """
    if not clamps.enabled:
        return
    inside, in_reach = proximity.inside, proximity.in_reach & ~proximity.inside
    carrier = np.where(inside[:, None], proximity.velocity, 0.0)
    allowed = np.where(in_reach, np.maximum(proximity.velocity[:, 2], 0.0), carrier[:, 2])
    rising = (velocity[:, 2] > allowed) & ~frozen
    velocity[rising, 2] = allowed[rising] + clamps.upward
    damped = ~in_reach & ~frozen
    share = clamps.horizontal_divisor ** (-dt / _REFERENCE_TIME_STEP)
    level = velocity[damped, :2] - carrier[damped, :2]
    velocity[damped, :2] = carrier[damped, :2] + share * level

"""Sleep: particles at rest are not integrated, and soil at rest in a tool moves with it.

A particle *sleeps* when it has hardly moved for a while relative to its carrier: the map, or a tool
that holds it. It then moves only with the carrier, costs next to nothing, and is a fixed obstacle
to awake particles. Soil that sleeps in a tool is its *locked load*: one rigid body together with
the tool, whose weight and inertia act on the tool.

In the order of a step:

- `sleep_state`: the values of `ParticleState.sleep_state`, and the columns that sleep kernels use
- `wake_disturbed`: which particles wake before a step, and which rows then move
    - `apparent_gravity`: gravity minus acceleration in each tool, which wakes a tilted or shaken
      load
    - `wake_conditions`: what wakes a sleeping particle
- `locked_load`: motion of the soil that is locked to a tool
- `fall_asleep`: which particles are touched awake in a step, and which fall asleep after it
    - `sleep_timers`: how long each awake particle has hardly moved
    - `support`: which particles rest on a tool, on something else, or on both
- `sleep_manager`: what an engine keeps for it from step to step
"""

from machine_sim.dem.sleep.sleep_manager import SleepManager
from machine_sim.dem.sleep.sleep_state import (
    ASLEEP_ON_MAP,
    AWAKE,
    FIRST_LOCKED_TOOL,
    locked_state,
    locked_tool,
)

__all__ = [
    "ASLEEP_ON_MAP",
    "AWAKE",
    "FIRST_LOCKED_TOOL",
    "SleepManager",
    "locked_state",
    "locked_tool",
]

"""Commands of a machine: from the inputs to the velocities that take effect in a tick.

- `actuators`: joints and tracks that can be commanded, and their limits
- `parser`: validation of each command as a whole, and its setpoints
- `joystick`: levers and pedals of an ISO or SAE cab from a gamepad
- `arbiter`: the newest command of each actuator, its timeout, and the emergency stop
- `conflict_detector`: several publishers that command the same actuators
- `position_control`: the velocity that moves a joint to an angle
- `params`, `errors`, `validation`: parameters, the error of a rejected command, checks of numbers

Independent of ROS, of the physics engine and of any clock: the caller passes the time.
"""

from machine_sim.commands.actuators import TRACK_NAMES
from machine_sim.commands.arbiter import (
    AppliedCommand,
    ArbiterState,
    CommandArbiter,
    CommandSource,
)
from machine_sim.commands.errors import CommandError
from machine_sim.commands.params import CommandParams

__all__ = [
    "TRACK_NAMES",
    "AppliedCommand",
    "ArbiterState",
    "CommandArbiter",
    "CommandError",
    "CommandParams",
    "CommandSource",
]

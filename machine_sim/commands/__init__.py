"""What a machine is told, from every input at once, to what it does in a tick.

- `board`: the newest command of each actuator, its age, and the emergency stop
- `inputs`: commands as they come in, checked whole before any of it counts
- `joystick`: levers and pedals of an ISO or SAE cab from a gamepad
- `goto`: the velocity that brings a joint to an angle
- `actuators`: joints and tracks that can be commanded, and what they can do
- `params`, `errors`, `checks`: settings, the error of a refused command, checks of numbers

No ROS, no physics, no clock: the caller says what time it is.
"""

from machine_sim.commands.actuators import TRACK_NAMES
from machine_sim.commands.arbiter import AppliedCommand, CommandArbiter, CommandSource
from machine_sim.commands.errors import CommandError
from machine_sim.commands.params import CommandParams

__all__ = [
    "TRACK_NAMES",
    "AppliedCommand",
    "CommandArbiter",
    "CommandError",
    "CommandParams",
    "CommandSource",
]

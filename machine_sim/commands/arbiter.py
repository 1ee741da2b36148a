"""Who commands what: the newest valid command of each actuator, for as long as it is renewed.

- Each joint and each track does what the newest command that named it says, whoever sent it. Two
  sources that both keep sending take turns; `AppliedCommand` says who had the say.
- A command not renewed within `command_timeout` is zero, and zero means hold.
- The emergency stop beats all. Commands that come while it is pressed are checked like any other
  and then dropped, and what was in force before is forgotten: after the release nothing moves but
  by a command that came after it, and the joystick must have been seen at rest.
- A command that is refused changes nothing.
- A clock that goes back (a simulation that is reset) voids the commands of its future.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.commands.actuators import list_actuators
from machine_sim.commands.errors import CommandError
from machine_sim.commands.joystick import Joystick
from machine_sim.commands.params import CommandParams
from machine_sim.commands.parser import CommandParser, Setpoint, Setpoints
from machine_sim.commands.position_control import velocity_to_target
from machine_sim.commands.validation import format_value, validate_numbers, validate_time

if TYPE_CHECKING:  # at run time the machine's package would load the physics engine
    from machine_sim.machine.spec import MachineSpec

__all__ = ["AppliedCommand", "CommandArbiter", "CommandSource"]

CommandSource = Literal["none", "front", "tracks", "joints", "twist", "joy", "emergency_stop"]
"""The input a value came from; `none` where nobody commands."""

_TIME_TOLERANCE = 1e-9
"""Times closer than this are the same [s]: sums of tick lengths are not exact."""


@dataclass(frozen=True, eq=False)
class AppliedCommand:
    """What takes effect in one tick; arrays are read-only.

    Attributes:
        joints: velocities of all joints [rad/s], shape (joints,).
        tracks: velocities left, right [m/s], shape (2,).
        joint_sources, track_sources: the input each value came from.
    """

    joints: NDArray[np.float64]
    tracks: NDArray[np.float64]
    joint_sources: tuple[CommandSource, ...]
    track_sources: tuple[CommandSource, ...]


@dataclass(frozen=True)
class _ActiveCommand:
    setpoint: Setpoint
    source: CommandSource
    arrival: float


class CommandArbiter:
    """Takes every input of one machine and says what it does in a tick.

    Times `now` [s] are when a command arrived and when a tick begins, by one clock of the caller's
    choice. Stamps and `sim_now` are simulation time [s]; without `sim_now` it is `now`. They are
    looked at only if `check_stamps` is set.

    Every input raises `CommandError` for what cannot be meant, and has then changed nothing.
    """

    def __init__(self, spec: MachineSpec, params: CommandParams | None = None) -> None:
        """
        Args:
            description: whose joints and tracks are commanded.
            params: defaults as shipped.
        """
        self.params = params or CommandParams()
        self._actuators = list_actuators(spec)
        self._num_joints = len(self._actuators) - 2
        self._parser = CommandParser(self._actuators, spec.tracks.gauge, self.params)
        self._joystick = Joystick(self._actuators, self.params, spec.joystick_axes)
        self._active: dict[int, _ActiveCommand] = {}
        self._tick_time = -np.inf
        self._stopped = False

    @property
    def is_stopped(self) -> bool:
        """Whether the emergency stop is pressed."""
        return self._stopped

    def front(self, values: ArrayLike, now: float) -> None:
        """Velocities of all joints in their order [rad/s], shape (joints,)."""
        self._accept(self._parser.front(values), "front", validate_time(now))

    def tracks(self, values: ArrayLike, now: float) -> None:
        """Track velocities left, right [m/s], shape (2,)."""
        self._accept(self._parser.tracks(values), "tracks", validate_time(now))

    def joints(
        self,
        names: ArrayLike,
        velocity: ArrayLike | None,
        position: ArrayLike | None,
        now: float,
        *,
        stamp: float | None = None,
        sim_now: float | None = None,
    ) -> None:
        """Velocities or angles of some joints; `left_track` and `right_track` are names too.

        Args:
            names: whom it concerns; the others go on as they were told.
            velocity: [rad/s, of tracks m/s] for each name, or empty.
            position: angle to go to and stay at [rad] for each name, or empty. It must be renewed
                like any command, on the way and after. Swing takes the shorter way around.
            now: [s].
            stamp: of the message [s], None if it has none.
            sim_now: [s].
        """
        arrival = self._check_arrival(now, stamp, sim_now)
        self._accept(self._parser.joints(names, velocity, position), "joints", arrival)

    def twist(
        self,
        linear: float,
        angular: float,
        now: float,
        *,
        stamp: float | None = None,
        sim_now: float | None = None,
    ) -> None:
        """Forward [m/s] and turning velocity [rad/s, + to the left], split onto the tracks."""
        arrival = self._check_arrival(now, stamp, sim_now)
        self._accept(self._parser.twist(linear, angular), "twist", arrival)

    def joy(
        self,
        axes: ArrayLike,
        buttons: ArrayLike,
        now: float,
        *,
        stamp: float | None = None,
        sim_now: float | None = None,
    ) -> None:
        """Axes (-1 to 1, + left and forward) and buttons of a joystick; see `joystick`."""
        arrival = self._check_arrival(now, stamp, sim_now)
        levers = self._joystick.read(axes, buttons)
        commands = self._joystick.select_commands(levers, stopped=self._stopped)
        self._accept({i: Setpoint(velocity) for i, velocity in commands.items()}, "joy", arrival)

    def emergency_stop(self, active: bool) -> None:
        """Press the emergency stop, or release it; it stays as it is until told otherwise."""
        if not isinstance(active, (bool, np.bool_)):
            raise CommandError(f"the emergency stop is {format_value(active)}; give true or false")
        self._stopped = bool(active)
        if self._stopped:
            self._active.clear()
            self._joystick.stop()

    def reset(self) -> None:
        """Drop every command in force, as after a reset; an emergency stop stays pressed."""
        self._active.clear()
        self._joystick.reset()

    def command_at(self, now: float, joint_positions: ArrayLike) -> AppliedCommand:
        """What takes effect in the tick that begins at `now`.

        Args:
            now: [s].
            joint_positions: angles of all joints as they are [rad], shape (joints,).

        Raises:
            CommandError: joint positions that are not one finite number for each joint.
        """
        time = validate_time(now)
        angles = validate_numbers(
            joint_positions, "joint_positions", f"{self._num_joints} angles [rad]"
        )
        if len(angles) != self._num_joints:
            raise CommandError(f"joint_positions has {len(angles)} values; give {self._num_joints}")
        self._drop_expired(time)
        values: list[float] = [0.0] * len(self._actuators)
        sources: list[CommandSource] = ["emergency_stop" if self._stopped else "none"] * len(values)
        for i, claim in self._active.items():
            values[i], limits = claim.setpoint.value, self._actuators[i].limits
            if claim.setpoint.is_position and limits is not None:
                values[i] = velocity_to_target(claim.setpoint.value, angles[i], limits)
            sources[i] = claim.source
        joints, tracks = np.array(values[: self._num_joints]), np.array(values[self._num_joints :])
        joints.setflags(write=False)
        tracks.setflags(write=False)
        return AppliedCommand(
            joints, tracks, tuple(sources[: self._num_joints]), tuple(sources[self._num_joints :])
        )

    def _check_arrival(self, now: float, stamp: float | None, sim_now: float | None) -> float:
        arrival = validate_time(now)
        self._parser.check_stamp(stamp, arrival if sim_now is None else validate_time(sim_now))
        return arrival

    def _accept(self, orders: Setpoints, source: CommandSource, arrival: float) -> None:
        if not self._stopped:
            self._active.update({i: _ActiveCommand(o, source, arrival) for i, o in orders.items()})

    def _drop_expired(self, time: float) -> None:
        """Drop what is too old, and what is of a future that will not be."""
        # A tick of a real-time loop may begin a little before the time at which the loop gets to
        # it, so a command may be younger than its tick. When ticks go back it is from another run.
        limit = self.params.command_timeout + _TIME_TOLERANCE
        youngest = -limit if time > self._tick_time - _TIME_TOLERANCE else -_TIME_TOLERANCE
        self._tick_time = time
        self._active = {
            i: claim
            for i, claim in self._active.items()
            if youngest <= time - claim.arrival <= limit
        }

"""Command arbitration: the newest valid command of each actuator, until it times out.

- The newest command that names a joint or a track applies to it, from any source. Two sources
  that both keep publishing alternate; `AppliedCommand` gives the source of each value, and
  `conflict_detector` detects it.
- A command that is not renewed within `command_timeout` becomes zero, and zero means hold.
- The emergency stop overrides all commands. Commands that arrive while it is active are checked and
  then dropped, and those in force before are cleared: after the release only a new command moves
  the machine, and the joystick must have been released first.
- An axis of a joystick counts once it has been at rest, also after the device was lost.
- A rejected command changes nothing.
- When the clock goes back (the simulation was reset), commands with a later arrival are dropped.
- A command may take effect later than it arrives; until then a stop clears it like those in force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.commands.actuators import list_actuators
from machine_sim.commands.errors import CommandError
from machine_sim.commands.joystick import Joystick, JoystickState
from machine_sim.commands.params import CommandParams
from machine_sim.commands.parser import CommandParser, Setpoint, Setpoints
from machine_sim.commands.position_control import velocity_to_target
from machine_sim.commands.validation import format_value, validate_numbers, validate_time

if TYPE_CHECKING:  # at run time the import would load the physics engine
    from machine_sim.machine.spec import MachineSpec

__all__ = ["AppliedCommand", "ArbiterState", "CommandArbiter", "CommandSource"]

CommandSource = Literal["none", "front", "tracks", "joints", "twist", "joy", "emergency_stop"]
"""Input that a value came from; `none` without a command in force."""

_TIME_TOLERANCE = 1e-9
"""Tolerance in the comparison of times [s]: sums of tick periods are not exact."""


@dataclass(frozen=True, eq=False)
class AppliedCommand:
    """Command that takes effect in one tick; arrays are read-only.

    Attributes:
        joints: velocities of all joints [rad/s], shape (joints,).
        tracks: velocities left, right [m/s], shape (2,).
        joint_sources, track_sources: input that each value came from.
    """

    joints: NDArray[np.float64]
    tracks: NDArray[np.float64]
    joint_sources: tuple[CommandSource, ...]
    track_sources: tuple[CommandSource, ...]


@dataclass(frozen=True)
class _ActiveCommand:
    """Setpoint of one actuator, its source, and its time of arrival [s]."""

    setpoint: Setpoint
    source: CommandSource
    arrival: float


class _DelayedCommand(NamedTuple):
    """Setpoints that take effect at a time [s], and their source."""

    effect_time: float
    setpoints: Setpoints
    source: CommandSource


class ArbiterState(NamedTuple):
    """What an arbiter has received.

    Attributes:
        is_stopped: whether the emergency stop is active.
        active: the newest command of each actuator, by its index.
        delayed: commands that take effect later, in the order of their arrival.
        joystick: levers and pedals.
    """

    is_stopped: bool
    active: Mapping[int, _ActiveCommand]
    delayed: tuple[_DelayedCommand, ...]
    joystick: JoystickState

    def without_timed(self) -> ArbiterState:
        """Return the state without the commands, whose times are by the clock of one process."""
        joystick = self.joystick._replace(last_arrival=-np.inf)
        return self._replace(active={}, delayed=(), joystick=joystick)


class CommandArbiter:
    """Receives the commands of one machine and selects what takes effect in a tick.

    Times `now` [s] are the arrival of a command and the start of a tick, by one clock of the
    caller's choice. Stamps and `sim_now` are simulation time [s]; `sim_now` is `now` by default.
    They are checked only if `check_stamps` is set.

    An invalid command raises `CommandError` and changes nothing. A method that receives a command
    returns its setpoints: none while the emergency stop is active, or for a joystick at rest.
    """

    def __init__(self, spec: MachineSpec, params: CommandParams | None = None) -> None:
        """
        Args:
            spec: machine whose joints and tracks are commanded.
            params: parameters of the inputs; shipped defaults if None.
        """
        self.params = params or CommandParams()
        self._actuators = list_actuators(spec)
        self._num_joints = len(self._actuators) - 2
        self._parser = CommandParser(self._actuators, spec.tracks.gauge, self.params)
        self._joystick = Joystick(self._actuators, self.params, spec.joystick_axes)
        self._active: dict[int, _ActiveCommand] = {}  # is replaced, not changed: see `state`
        self._delayed: tuple[_DelayedCommand, ...] = ()
        self._tick_time = -np.inf
        self._is_stopped = False

    @property
    def is_stopped(self) -> bool:
        """Whether the emergency stop is active."""
        return self._is_stopped

    @property
    def ignored_joystick_axes(self) -> list[str]:
        """Axes of the joystick that do not count yet, since they have not been at rest."""
        return self._joystick.ignored_axes(self._tick_time)

    @property
    def delayed_effect_times(self) -> list[float]:
        """Times at which the delayed commands take effect [s], in the order of their arrival."""
        return [each.effect_time for each in self._delayed]

    @property
    def state(self) -> ArbiterState:
        """What it has received."""
        return ArbiterState(self._is_stopped, self._active, self._delayed, self._joystick.state)

    def restore(self, state: ArbiterState) -> None:
        """Set what it has received, by the same clock."""
        self._is_stopped = state.is_stopped
        self._active, self._delayed = dict(state.active), state.delayed
        self._joystick.restore(state.joystick)

    def receive_front(self, values: ArrayLike, now: float) -> Setpoints:
        """Receive velocities of all joints in their order [rad/s], shape (joints,)."""
        return self._accept(self._parser.parse_front(values), "front", validate_time(now))

    def receive_tracks(self, values: ArrayLike, now: float) -> Setpoints:
        """Receive track velocities left, right [m/s], shape (2,)."""
        return self._accept(self._parser.parse_tracks(values), "tracks", validate_time(now))

    def receive_joints(
        self,
        names: ArrayLike,
        velocity: ArrayLike | None,
        position: ArrayLike | None,
        now: float,
        *,
        stamp: float | None = None,
        sim_now: float | None = None,
        effect_time: float | None = None,
    ) -> Setpoints:
        """Receive velocities or angles of some joints and tracks.

        Args:
            names: joints, `left_track` and `right_track`; the command leaves all others unchanged.
            velocity: [rad/s, tracks m/s] for each name, or empty.
            position: target angle [rad] for each name, or empty. Like any command it must be
                renewed, also at the target. Swing turns in the shorter direction.
            now: time of arrival [s].
            stamp: stamp of the message [s], None if it has none.
            sim_now: present simulation time [s].
            effect_time: start of the tick in which it takes effect [s]. If it is past, the command
                has arrived before: it lasts no longer, and does not replace a newer one.
        """
        arrival = self._check_arrival(now, stamp, sim_now)
        setpoints = self._parser.parse_joints(names, velocity, position)
        return self._accept(setpoints, "joints", arrival, effect_time)

    def receive_twist(
        self,
        linear: float,
        angular: float,
        now: float,
        *,
        stamp: float | None = None,
        sim_now: float | None = None,
        effect_time: float | None = None,
    ) -> Setpoints:
        """Receive forward [m/s] and yaw velocity [rad/s, + to the left] of the machine."""
        arrival = self._check_arrival(now, stamp, sim_now)
        return self._accept(
            self._parser.parse_twist(linear, angular), "twist", arrival, effect_time
        )

    def receive_joy(
        self,
        axes: ArrayLike,
        buttons: ArrayLike,
        now: float,
        *,
        stamp: float | None = None,
        sim_now: float | None = None,
    ) -> Setpoints:
        """Receive axes (-1 to 1, + left and forward) and buttons of a joystick; see `joystick`."""
        arrival = self._check_arrival(now, stamp, sim_now)
        reading = self._joystick.read(axes, buttons)
        commands = self._joystick.select_commands(reading, arrival, stopped=self._is_stopped)
        return self._accept(
            {i: Setpoint(velocity) for i, velocity in commands.items()}, "joy", arrival
        )

    def emergency_stop(self, active: bool) -> None:
        """Activate the emergency stop, or release it; it keeps its state until the next call."""
        if not isinstance(active, (bool, np.bool_)):
            raise CommandError(f"the emergency stop is {format_value(active)}; give true or false")
        self._is_stopped = bool(active)
        if self._is_stopped:
            self._active, self._delayed = {}, ()
            self._joystick.stop()

    def reset(self) -> None:
        """Drop all commands, as after a reset; an emergency stop stays active."""
        self._active, self._delayed = {}, ()
        self._joystick.reset()

    def command_at(self, now: float, joint_positions: ArrayLike) -> AppliedCommand:
        """Return the command that takes effect in the tick that begins at `now`.

        Args:
            now: start of the tick [s].
            joint_positions: present angles of all joints [rad], shape (joints,).

        Raises:
            CommandError: joint positions that are not one finite number for each joint.
        """
        time = validate_time(now)
        angles = validate_numbers(
            joint_positions, "joint_positions", f"{self._num_joints} angles [rad]"
        )
        if len(angles) != self._num_joints:
            raise CommandError(f"joint_positions has {len(angles)} values; give {self._num_joints}")
        self._put_due_in_force(time)
        self._drop_expired(time)
        values: list[float] = [0.0] * len(self._actuators)
        sources: list[CommandSource] = ["emergency_stop" if self._is_stopped else "none"] * len(
            values
        )
        for i, command in self._active.items():
            values[i], limits = command.setpoint.value, self._actuators[i].limits
            if command.setpoint.is_position and limits is not None:
                values[i] = velocity_to_target(command.setpoint.value, angles[i], limits)
            sources[i] = command.source
        joints, tracks = np.array(values[: self._num_joints]), np.array(values[self._num_joints :])
        joints.setflags(write=False)
        tracks.setflags(write=False)
        return AppliedCommand(
            joints, tracks, tuple(sources[: self._num_joints]), tuple(sources[self._num_joints :])
        )

    def _check_arrival(self, now: float, stamp: float | None, sim_now: float | None) -> float:
        """Check the stamp of a command, and return its time of arrival [s]."""
        arrival = validate_time(now)
        self._parser.check_stamp(stamp, arrival if sim_now is None else validate_time(sim_now))
        return arrival

    def _accept(
        self,
        setpoints: Setpoints,
        source: CommandSource,
        arrival: float,
        effect_time: float | None = None,
    ) -> Setpoints:
        """Put setpoints in force now or later, and return them; none if the stop is active."""
        if self._is_stopped:
            return {}
        if effect_time is not None:
            if effect_time > arrival + _TIME_TOLERANCE:
                self._delayed = (*self._delayed, _DelayedCommand(effect_time, setpoints, source))
                return setpoints
            arrival = min(arrival, effect_time)
        active = self._active
        commands = {
            i: _ActiveCommand(each, source, arrival)
            for i, each in setpoints.items()
            if effect_time is None or i not in active or active[i].arrival <= arrival
        }
        self._active = {**active, **commands}
        return setpoints

    def _put_due_in_force(self, time: float) -> None:
        """Put the delayed commands that are due in force, in the order of their times."""
        if not self._delayed:
            return
        latest = time + _TIME_TOLERANCE
        due = [each for each in self._delayed if each.effect_time <= latest]
        self._delayed = tuple(each for each in self._delayed if each.effect_time > latest)
        for each in sorted(due, key=lambda each: each.effect_time):
            self._accept(each.setpoints, each.source, time)

    def _drop_expired(self, time: float) -> None:
        """Drop commands that timed out, and those of a run that was reset."""
        # The tick of a real-time loop may start slightly before the loop processes it, so a command
        # may be younger than its tick. If time goes back, such a command is from another run.
        max_age = self.params.command_timeout + _TIME_TOLERANCE
        min_age = -max_age if time > self._tick_time - _TIME_TOLERANCE else -_TIME_TOLERANCE
        self._tick_time = time
        self._active = {
            i: command
            for i, command in self._active.items()
            if min_age <= time - command.arrival <= max_age
        }

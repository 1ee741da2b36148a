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

from machine_sim.commands.actuators import actuators_of
from machine_sim.commands.checks import instant, numbers, shown
from machine_sim.commands.errors import CommandError
from machine_sim.commands.goto import velocity_toward
from machine_sim.commands.inputs import Inputs, Order, Orders
from machine_sim.commands.joystick import Joystick
from machine_sim.commands.params import CommandParams

if TYPE_CHECKING:  # at run time the machine's package would load the physics engine
    from machine_sim.machine.description import MachineDescription

__all__ = ["AppliedCommand", "CommandBoard", "Source"]

Source = Literal["none", "front", "tracks", "joints", "twist", "joy", "emergency_stop"]
"""The input a value came from; `none` where nobody commands."""

_SAME_TIME = 1e-9
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
    joint_sources: tuple[Source, ...]
    track_sources: tuple[Source, ...]


@dataclass(frozen=True)
class _Claim:
    order: Order
    source: Source
    arrival: float


class CommandBoard:
    """Takes every input of one machine and says what it does in a tick.

    Times `now` [s] are when a command arrived and when a tick begins, by one clock of the caller's
    choice. Stamps and `sim_now` are simulation time [s]; without `sim_now` it is `now`. They are
    looked at only if `check_stamps` is set.

    Every input raises `CommandError` for what cannot be meant, and has then changed nothing.
    """

    def __init__(
        self, description: MachineDescription, params: CommandParams | None = None
    ) -> None:
        """
        Args:
            description: whose joints and tracks are commanded.
            params: defaults as shipped.
        """
        self.params = params or CommandParams()
        self._actuators = actuators_of(description)
        self._count = len(self._actuators) - 2
        self._inputs = Inputs(self._actuators, description.tracks.gauge, self.params)
        self._joystick = Joystick(self._actuators, self.params, description.levers)
        self._claims: dict[int, _Claim] = {}
        self._tick_time = -np.inf
        self._stopped = False

    @property
    def stopped(self) -> bool:
        """Whether the emergency stop is pressed."""
        return self._stopped

    def front(self, values: ArrayLike, now: float) -> None:
        """Velocities of all joints in their order [rad/s], shape (joints,)."""
        self._take(self._inputs.front(values), "front", instant(now))

    def tracks(self, values: ArrayLike, now: float) -> None:
        """Track velocities left, right [m/s], shape (2,)."""
        self._take(self._inputs.tracks(values), "tracks", instant(now))

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
        arrival = self._arrival(now, stamp, sim_now)
        self._take(self._inputs.joints(names, velocity, position), "joints", arrival)

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
        arrival = self._arrival(now, stamp, sim_now)
        self._take(self._inputs.twist(linear, angular), "twist", arrival)

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
        arrival = self._arrival(now, stamp, sim_now)
        levers = self._joystick.read(axes, buttons)
        commands = self._joystick.take(levers, stopped=self._stopped)
        self._take({i: Order(velocity) for i, velocity in commands.items()}, "joy", arrival)

    def emergency_stop(self, active: bool) -> None:
        """Press the emergency stop, or release it; it stays as it is until told otherwise."""
        if not isinstance(active, (bool, np.bool_)):
            raise CommandError(f"the emergency stop is {shown(active)}; give true or false")
        self._stopped = bool(active)
        if self._stopped:
            self._claims.clear()
            self._joystick.stop()

    def forget(self) -> None:
        """Drop every command in force, as after a reset; an emergency stop stays pressed."""
        self._claims.clear()
        self._joystick.forget()

    def at(self, now: float, joint_positions: ArrayLike) -> AppliedCommand:
        """What takes effect in the tick that begins at `now`.

        Args:
            now: [s].
            joint_positions: angles of all joints as they are [rad], shape (joints,).

        Raises:
            CommandError: joint positions that are not one finite number for each joint.
        """
        time = instant(now)
        angles = numbers(joint_positions, "joint_positions", f"{self._count} angles [rad]")
        if len(angles) != self._count:
            raise CommandError(f"joint_positions has {len(angles)} values; give {self._count}")
        self._drop_void(time)
        values: list[float] = [0.0] * len(self._actuators)
        sources: list[Source] = ["emergency_stop" if self._stopped else "none"] * len(values)
        for i, claim in self._claims.items():
            values[i], limits = claim.order.value, self._actuators[i].limits
            if claim.order.is_goal and limits is not None:
                values[i] = velocity_toward(claim.order.value, angles[i], limits)
            sources[i] = claim.source
        joints, tracks = np.array(values[: self._count]), np.array(values[self._count :])
        joints.setflags(write=False)
        tracks.setflags(write=False)
        return AppliedCommand(
            joints, tracks, tuple(sources[: self._count]), tuple(sources[self._count :])
        )

    def _arrival(self, now: float, stamp: float | None, sim_now: float | None) -> float:
        arrival = instant(now)
        self._inputs.check_stamp(stamp, arrival if sim_now is None else instant(sim_now))
        return arrival

    def _take(self, orders: Orders, source: Source, arrival: float) -> None:
        if not self._stopped:
            self._claims.update({i: _Claim(o, source, arrival) for i, o in orders.items()})

    def _drop_void(self, time: float) -> None:
        """Drop what is too old, and what is of a future that will not be."""
        # A tick of a real-time loop may begin a little before the time at which the loop gets to
        # it, so a command may be younger than its tick. When ticks go back it is from another run.
        limit = self.params.command_timeout + _SAME_TIME
        youngest = -limit if time > self._tick_time - _SAME_TIME else -_SAME_TIME
        self._tick_time = time
        self._claims = {
            i: claim
            for i, claim in self._claims.items()
            if youngest <= time - claim.arrival <= limit
        }

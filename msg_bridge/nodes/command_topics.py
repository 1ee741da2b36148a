"""A machine's command topics, handed to whoever decides on them."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64MultiArray

from msg_bridge.codec import qos
from msg_bridge.codec.stamps import seconds_of_stamp
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.nodes.inbox import Inbox

__all__ = ["Board", "CommandTopics", "Times"]


class Board(Protocol):
    """Takes commands; each method refuses what cannot be meant by an EarthmovingError."""

    def front(self, values: Any, now: float) -> None: ...
    def tracks(self, values: Any, now: float) -> None: ...
    def joints(
        self, names: Any, velocity: Any, position: Any, now: float, *, stamp: Any, sim_now: Any
    ) -> None: ...
    def twist(
        self, linear: float, angular: float, now: float, *, stamp: Any, sim_now: Any
    ) -> None: ...
    def joy(self, axes: Any, buttons: Any, now: float, *, stamp: Any, sim_now: Any) -> None: ...
    def emergency_stop(self, active: bool) -> None: ...


class Times(Protocol):
    """Tells a command's time of arrival."""

    @property
    def sim_time(self) -> float: ...
    def command_time(self, wall: float) -> float: ...
    def hear(self, stamp: float, deliver: Callable[[], bool]) -> None: ...


class CommandTopics:
    """Subscriptions to the commands of one machine, in its node's namespace or a folder of it."""

    def __init__(
        self,
        inbox: Inbox,
        board: Board,
        times: Callable[[], Times | None],
        refuse: Callable[[str, str], None],
        folder: str = "",
    ) -> None:
        """
        Args:
            inbox: of the machine's node, for its commands.
            board: takes what comes.
            times: tells the time; None while there is no run, and commands are refused.
            refuse: told topic and reason of a command that is refused.
            folder: put before each topic's name: empty, or a machine's name and a slash.
        """
        self._board, self._times = board, times
        self._refuse = refuse

        def subscribe(kind: Any, name: str, take: Callable[[Any, Times], None]) -> None:
            topic = folder + name
            profile = qos.STATE if kind is Bool else qos.COMMANDS
            inbox.subscribe(kind, topic, profile, partial(self._hear, topic, take))

        subscribe(Float64MultiArray, "front_velocity_controller/commands", self._front)
        subscribe(Float64MultiArray, "track_velocity_controller/commands", self._tracks)
        subscribe(JointState, "joint_commands", self._joints)
        subscribe(TwistStamped, "cmd_vel", self._twist)
        subscribe(Joy, "joy", self._joy)
        subscribe(Bool, "emergency_stop", self._stop)

    def _hear(self, topic: str, take: Callable[[Any, Times], None], msg: Any) -> None:
        times = self._times()
        if times is None and not isinstance(msg, Bool):
            self._refuse(topic, "the machine takes no part yet; command it once it has joined")
            return
        deliver = partial(self._take, topic, take, msg, times)
        if times is not None and isinstance(msg, (JointState, TwistStamped)):
            times.hear(seconds_of_stamp(msg.header.stamp), deliver)
        else:
            deliver()

    def _take(self, topic: str, take: Callable[[Any, Any], None], msg: Any, times: Any) -> bool:
        """Hand a command to the board; whether it was good."""
        try:
            take(msg, times)
        except EarthmovingError as error:
            self._refuse(topic, str(error))
            return False
        return True

    def _front(self, msg: Float64MultiArray, times: Times) -> None:
        self._board.front(msg.data, _now(times))

    def _tracks(self, msg: Float64MultiArray, times: Times) -> None:
        self._board.tracks(msg.data, _now(times))

    def _joints(self, msg: JointState, times: Times) -> None:
        self._board.joints(
            msg.name, msg.velocity, msg.position, _now(times), **_stamped(msg, times)
        )

    def _twist(self, msg: TwistStamped, times: Times) -> None:
        twist = msg.twist
        self._board.twist(twist.linear.x, twist.angular.z, _now(times), **_stamped(msg, times))

    def _joy(self, msg: Joy, times: Times) -> None:
        self._board.joy(msg.axes, msg.buttons, _now(times), **_stamped(msg, times))

    def _stop(self, msg: Bool, times: Times) -> None:
        self._board.emergency_stop(bool(msg.data))


def _now(times: Times) -> float:
    return times.command_time(time.monotonic())


def _stamped(msg: Any, times: Times) -> dict[str, float | None]:
    """When the message says it was made; a zero stamp says nothing."""
    stamp: Time = msg.header.stamp
    said = stamp.sec or stamp.nanosec
    return {"stamp": seconds_of_stamp(stamp) if said else None, "sim_now": times.sim_time}

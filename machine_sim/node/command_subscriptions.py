"""Subscriptions to the command topics of one machine, other than its emergency stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray

from machine_sim.commands.parser import Setpoints
from msg_bridge.codec import qos
from msg_bridge.codec.stamps import seconds_from_stamp
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.nodes.subscription_poller import SubscriptionPoller

__all__ = ["CommandClock", "CommandReceiver", "CommandSubscriptions"]


class CommandReceiver(Protocol):
    """Receives commands, and returns their setpoints.

    Each method raises an EarthmovingError for an invalid command.
    """

    def receive_front(self, values: Any, now: float) -> Setpoints: ...
    def receive_tracks(self, values: Any, now: float) -> Setpoints: ...
    def receive_joints(
        self,
        names: Any,
        velocity: Any,
        position: Any,
        now: float,
        *,
        stamp: Any,
        sim_now: Any,
        effect_time: float | None,
    ) -> Setpoints: ...
    def receive_twist(
        self,
        linear: float,
        angular: float,
        now: float,
        *,
        stamp: Any,
        sim_now: Any,
        effect_time: float | None,
    ) -> Setpoints: ...
    def receive_joy(
        self, axes: Any, buttons: Any, now: float, *, stamp: Any, sim_now: Any
    ) -> Setpoints: ...


class CommandClock(Protocol):
    """Gives commands their time of arrival, and schedules stamped ones."""

    @property
    def sim_time(self) -> float: ...
    def command_time(self, wall: float) -> float: ...
    def receive(self, stamp: float, deliver: Callable[[float | None], bool]) -> None: ...


class CommandSubscriptions:
    """Command topics of one machine: each message is passed to the receiver at its time."""

    def __init__(
        self,
        poller: SubscriptionPoller,
        receiver: CommandReceiver,
        clock: Callable[[], CommandClock | None],
        reject: Callable[[str, str], None],
        topic_prefix: str = "",
        *,
        record: Callable[[], None] = lambda: None,
        observe: Callable[[str, int | None, Setpoints], None] = lambda *_: None,
    ) -> None:
        """
        Args:
            poller: poller of the machine node for commands.
            receiver: receives the commands.
            clock: returns the clock; None while there is no run, when commands are rejected.
            reject: called with topic and reason of a rejected command.
            topic_prefix: prefix of each topic: empty, or a machine's name and a slash.
            record: called after a command that takes effect later was received.
            observe: called with each valid command: its topic, its number among the messages of its
                publisher, None if unknown, and its setpoints.
        """
        self._receiver, self._clock = receiver, clock
        self._reject, self._record, self._observe = reject, record, observe

        def subscribe(kind: Any, name: str, take: Callable[..., Setpoints]) -> None:
            topic = topic_prefix + name
            take_message = partial(self._on_message, topic, take)
            poller.subscribe(kind, topic, qos.COMMANDS, take_message, with_info=True)

        subscribe(Float64MultiArray, topics.FRONT_VELOCITY_COMMANDS, self._front)
        subscribe(Float64MultiArray, topics.TRACK_VELOCITY_COMMANDS, self._tracks)
        subscribe(JointState, topics.JOINT_COMMANDS, self._joints)
        subscribe(TwistStamped, topics.CMD_VEL, self._twist)
        subscribe(Joy, topics.JOY, self._joy)

    def _on_message(self, topic: str, take: Callable[..., Setpoints], msg: Any, info: Any) -> None:
        """Schedule a stamped command, and deliver any other one at once."""
        clock = self._clock()
        if clock is None:
            self._reject(topic, "the machine is in no run yet; command it once it has joined")
            return
        number = info["publication_sequence_number"]
        if isinstance(msg, (JointState, TwistStamped)):
            deliver = partial(
                self._deliver_stamped, topic, number, clock.sim_time, partial(take, msg, clock)
            )
            clock.receive(seconds_from_stamp(msg.header.stamp), deliver)
        else:
            self._deliver(topic, number, partial(take, msg, clock))

    def _deliver_stamped(
        self,
        topic: str,
        number: int | None,
        sim_now: float,
        take: Callable[[float | None], Setpoints],
        effect_time: float | None,
    ) -> bool:
        """Deliver a command that takes effect at a simulation time [s], None: now."""
        is_valid = self._deliver(topic, number, partial(take, effect_time))
        if is_valid and effect_time is not None and effect_time > sim_now:
            self._record()
        return is_valid

    def _deliver(self, topic: str, number: int | None, take: Callable[[], Setpoints]) -> bool:
        """Pass a command to the receiver, and return whether it was valid."""
        try:
            setpoints = take()
        except EarthmovingError as error:
            self._reject(topic, str(error))
            return False
        self._observe(topic, number, setpoints)
        return True

    def _front(self, msg: Float64MultiArray, clock: CommandClock) -> Setpoints:
        return self._receiver.receive_front(msg.data, _now(clock))

    def _tracks(self, msg: Float64MultiArray, clock: CommandClock) -> Setpoints:
        return self._receiver.receive_tracks(msg.data, _now(clock))

    def _joints(self, msg: JointState, clock: CommandClock, effect_time: float | None) -> Setpoints:
        return self._receiver.receive_joints(
            msg.name,
            msg.velocity,
            msg.position,
            _now(clock),
            **_stamp_arguments(msg, clock),
            effect_time=effect_time,
        )

    def _twist(
        self, msg: TwistStamped, clock: CommandClock, effect_time: float | None
    ) -> Setpoints:
        twist, stamp = msg.twist, _stamp_arguments(msg, clock)
        return self._receiver.receive_twist(
            twist.linear.x, twist.angular.z, _now(clock), **stamp, effect_time=effect_time
        )

    def _joy(self, msg: Joy, clock: CommandClock) -> Setpoints:
        return self._receiver.receive_joy(
            msg.axes, msg.buttons, _now(clock), **_stamp_arguments(msg, clock)
        )


def _now(clock: CommandClock) -> float:
    """Return the time of arrival of a command that is received now [s]."""
    return clock.command_time(time.monotonic())


def _stamp_arguments(msg: Any, clock: CommandClock) -> dict[str, float | None]:
    """Return the stamp of a message and the simulation time; a zero stamp counts as none."""
    stamp: Time = msg.header.stamp
    is_stamped = stamp.sec or stamp.nanosec
    return {"stamp": seconds_from_stamp(stamp) if is_stamped else None, "sim_now": clock.sim_time}

"""Command topics of a machine: the receiver gets each message with its time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray

from machine_sim.commands.parser import Setpoints
from machine_sim.node.command_subscriptions import CommandSubscriptions
from msg_bridge.codec.qos import COMMANDS
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.testing.ros_context import Ros

STAMP = 12.5


class CommandReceiver:
    """Records received commands, and rejects all while `rejection` is set."""

    def __init__(self) -> None:
        self.received: list[tuple[Any, ...]] = []
        self.rejection = ""

    def _take(self, *what: Any) -> Setpoints:
        if self.rejection:
            raise EarthmovingError(self.rejection)
        self.received.append(what)
        return {}

    def receive_front(self, values: Any, now: float) -> Setpoints:
        return self._take("front", list(values), now)

    def receive_tracks(self, values: Any, now: float) -> Setpoints:
        return self._take("tracks", list(values), now)

    def receive_joints(
        self, names: Any, velocity: Any, position: Any, now: float, **times: float | None
    ) -> Setpoints:
        return self._take(
            "joints", list(names), list(velocity), list(position), now, *times.values()
        )

    def receive_twist(
        self, linear: float, angular: float, now: float, **times: float | None
    ) -> Setpoints:
        return self._take("twist", linear, angular, now, *times.values())

    def receive_joy(
        self, axes: Any, buttons: Any, now: float, *, stamp: Any, sim_now: Any
    ) -> Setpoints:
        return self._take("joy", list(axes), list(buttons), now, stamp, sim_now)


class CommandClock:
    """A run at 3 s of simulated time whose commands arrive at 77 s.

    Attributes:
        effect_time: when stamped commands take effect; None: at once.
        stamps: those of valid commands.
    """

    sim_time = 3.0

    def __init__(self) -> None:
        self.effect_time: float | None = None
        self.stamps: list[float] = []

    def command_time(self, wall: float) -> float:
        return 77.0

    def receive(self, stamp: float, deliver: Callable[[float | None], bool]) -> None:
        if deliver(self.effect_time):
            self.stamps.append(stamp)


class Machine:
    """A node with the command topics, a recording receiver, and a publisher of commands."""

    def __init__(self, ros: Ros) -> None:
        self.ros, self.receiver, self.times = ros, CommandReceiver(), CommandClock()
        self.running = True
        self.rejected: list[tuple[str, str]] = []
        self.num_wake_ups = self.num_records = 0
        self.node = ros.node("machine", namespace="/digger")
        self.topics = CommandSubscriptions(
            SubscriptionPoller(self.node, self.wake),
            self.receiver,
            lambda: self.times if self.running else None,
            lambda topic, reason: self.rejected.append((topic, reason)),
            record=self.record,
        )

    def record(self) -> None:
        self.num_records += 1

    def wake(self) -> None:
        self.num_wake_ups += 1

    def send(self, topic: str, message: Any) -> None:
        publisher = self.ros.publisher(f"/digger/{topic}", type(message), subscriptions=1)
        before = self.num_wake_ups
        publisher.publish(message)
        self.ros.spin_until(lambda: self.num_wake_ups > before, what=f"a message on {topic}")


@pytest.fixture
def machine(ros: Ros) -> Machine:
    return Machine(ros)


def stamped(message: Any, seconds: float = STAMP) -> Any:
    message.header.stamp = stamp_from_seconds(seconds)
    return message


def twist(linear: float, angular: float) -> TwistStamped:
    message = TwistStamped()
    message.twist.linear.x, message.twist.angular.z = linear, angular
    return message


ALL: list[tuple[str, Callable[[], Any], tuple[Any, ...]]] = [
    (
        "front_velocity_controller/commands",
        lambda: Float64MultiArray(data=[0.1, 0.2, 0.3, 0.4]),
        ("front", [0.1, 0.2, 0.3, 0.4], 77.0),
    ),
    (
        "track_velocity_controller/commands",
        lambda: Float64MultiArray(data=[0.5, -0.5]),
        ("tracks", [0.5, -0.5], 77.0),
    ),
    (
        "joint_commands",
        lambda: stamped(JointState(name=["arm"], velocity=[0.5])),
        ("joints", ["arm"], [0.5], [], 77.0, STAMP, 3.0, None),
    ),
    (
        "joint_commands",
        lambda: stamped(JointState(name=["arm", "boom"], position=[0.5, 1.0])),
        ("joints", ["arm", "boom"], [], [0.5, 1.0], 77.0, STAMP, 3.0, None),
    ),
    ("cmd_vel", lambda: stamped(twist(0.5, -0.25)), ("twist", 0.5, -0.25, 77.0, STAMP, 3.0, None)),
    (
        "joy",
        lambda: stamped(Joy(axes=[0.5, -1.0], buttons=[0, 1])),
        ("joy", [0.5, -1.0], [0, 1], 77.0, STAMP, 3.0),
    ),
]


@pytest.mark.parametrize(("topic", "message", "expected"), ALL)
def test_receiver_gets_each_message_with_its_time_of_arrival(
    machine: Machine, topic: str, message: Callable[[], Any], expected: tuple[Any, ...]
) -> None:
    machine.send(topic, message())
    assert machine.receiver.received == [expected]
    assert machine.rejected == []


@pytest.mark.parametrize(
    ("topic", "message"),
    [("joint_commands", JointState(name=["arm"], velocity=[0.5])), ("cmd_vel", twist(1.0, 0.0))],
)
def test_zero_stamp_counts_as_no_stamp(machine: Machine, topic: str, message: Any) -> None:
    machine.send(topic, message)
    assert machine.receiver.received[0][-3:] == (None, 3.0, None)


def test_joint_and_twist_commands_are_scheduled_by_their_stamp(machine: Machine) -> None:
    for topic, message, _ in ALL:
        machine.send(topic, message())
    assert machine.times.stamps == [STAMP] * 3  # two of joint_commands, one of cmd_vel


def test_command_that_takes_effect_later_is_recorded_when_it_arrives(machine: Machine) -> None:
    machine.times.effect_time = 3.02
    for topic, message, _ in ALL:
        machine.send(topic, message())
    delayed = [each for each in machine.receiver.received if each[-1] == 3.02]
    assert [each[0] for each in delayed] == ["joints", "joints", "twist"]
    assert machine.num_records == 3


def test_rejected_command_is_reported_and_not_scheduled(machine: Machine) -> None:
    machine.receiver.rejection = "no such joint; name another"
    for topic, message, _ in ALL:
        machine.send(topic, message())
    assert machine.rejected == [(topic, "no such joint; name another") for topic, _, _ in ALL]
    assert machine.times.stamps == []


def test_no_command_is_accepted_without_a_run(machine: Machine) -> None:
    machine.running = False
    for topic, message, _ in ALL:
        machine.send(topic, message())
    assert machine.receiver.received == []
    assert [topic for topic, _ in machine.rejected] == [topic for topic, _, _ in ALL]
    assert all("once it has joined" in reason for _, reason in machine.rejected)


def test_best_effort_publisher_is_received(machine: Machine, ros: Ros) -> None:
    publisher = ros.publisher("/digger/cmd_vel", TwistStamped, COMMANDS, subscriptions=1)

    def received() -> bool:
        publisher.publish(twist(1.0, 0.0))
        return bool(machine.receiver.received)

    ros.spin_until(received)


def test_waiting_commands_are_taken_in_one_wake_up(machine: Machine, ros: Ros) -> None:
    publishers = [
        ros.publisher(f"/digger/{topic}", type(message()), subscriptions=1)
        for topic, message, _ in ALL
    ]
    for publisher, (_, message, _) in zip(publishers, ALL, strict=True):
        publisher.publish(message())
    ros.spin_until(lambda: len(machine.receiver.received) == len(ALL))
    assert machine.num_wake_ups <= len(ALL)

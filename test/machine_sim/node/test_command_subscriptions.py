"""A machine's command topics: what is handed to whoever decides, with which time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64MultiArray

from machine_sim.node.command_subscriptions import CommandSubscriptions
from msg_bridge.codec.qos import COMMANDS
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.testing.ros_context import Ros

STAMP = 12.5


class CommandReceiver:
    """Writes down what it is told; refuses what the test says."""

    def __init__(self) -> None:
        self.told: list[tuple[Any, ...]] = []
        self.refusal = ""

    def _take(self, *what: Any) -> None:
        if self.refusal:
            raise EarthmovingError(self.refusal)
        self.told.append(what)

    def front(self, values: Any, now: float) -> None:
        self._take("front", list(values), now)

    def tracks(self, values: Any, now: float) -> None:
        self._take("tracks", list(values), now)

    def joints(
        self, names: Any, velocity: Any, position: Any, now: float, *, stamp: Any, sim_now: Any
    ) -> None:
        self._take("joints", list(names), list(velocity), list(position), now, stamp, sim_now)

    def twist(self, linear: float, angular: float, now: float, *, stamp: Any, sim_now: Any) -> None:
        self._take("twist", linear, angular, now, stamp, sim_now)

    def joy(self, axes: Any, buttons: Any, now: float, *, stamp: Any, sim_now: Any) -> None:
        self._take("joy", list(axes), list(buttons), now, stamp, sim_now)

    def emergency_stop(self, active: bool) -> None:
        self._take("emergency_stop", active)


class CommandClock:
    """A run at 3 s of simulated time whose commands arrive at 77 s."""

    sim_time = 3.0

    def __init__(self) -> None:
        self.noted: list[float] = []

    def command_time(self, wall: float) -> float:
        return 77.0

    def receive(self, stamp: float, deliver: Callable[[], bool]) -> None:
        if deliver():
            self.noted.append(stamp)


class Machine:
    """A node with the command topics, what came of them, and a sender."""

    def __init__(self, ros: Ros) -> None:
        self.ros, self.receiver, self.times = ros, CommandReceiver(), CommandClock()
        self.running = True
        self.refused: list[tuple[str, str]] = []
        self.woken = 0
        self.node = ros.node("machine", namespace="/digger")
        self.topics = CommandSubscriptions(
            SubscriptionPoller(self.node, self.wake),
            self.receiver,
            lambda: self.times if self.running else None,
            lambda topic, reason: self.refused.append((topic, reason)),
        )

    def wake(self) -> None:
        self.woken += 1

    def send(self, topic: str, message: Any) -> None:
        publisher = self.ros.publisher(f"/digger/{topic}", type(message), subscriptions=1)
        before = self.woken
        publisher.publish(message)
        self.ros.spin_until(lambda: self.woken > before, what=f"a message on {topic}")


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
        ("joints", ["arm"], [0.5], [], 77.0, STAMP, 3.0),
    ),
    (
        "joint_commands",
        lambda: stamped(JointState(name=["arm", "boom"], position=[0.5, 1.0])),
        ("joints", ["arm", "boom"], [], [0.5, 1.0], 77.0, STAMP, 3.0),
    ),
    ("cmd_vel", lambda: stamped(twist(0.5, -0.25)), ("twist", 0.5, -0.25, 77.0, STAMP, 3.0)),
    (
        "joy",
        lambda: stamped(Joy(axes=[0.5, -1.0], buttons=[0, 1])),
        ("joy", [0.5, -1.0], [0, 1], 77.0, STAMP, 3.0),
    ),
    ("emergency_stop", lambda: Bool(data=True), ("emergency_stop", True)),
]


@pytest.mark.parametrize(("topic", "message", "told"), ALL)
def test_a_message_reaches_the_board_with_its_time_of_arrival(
    machine: Machine, topic: str, message: Callable[[], Any], told: tuple[Any, ...]
) -> None:
    machine.send(topic, message())
    assert machine.receiver.told == [told]
    assert machine.refused == []


@pytest.mark.parametrize(
    ("topic", "message"),
    [("joint_commands", JointState(name=["arm"], velocity=[0.5])), ("cmd_vel", twist(1.0, 0.0))],
)
def test_a_zero_stamp_is_no_stamp(machine: Machine, topic: str, message: Any) -> None:
    machine.send(topic, message)
    assert machine.receiver.told[0][-2:] == (None, 3.0)


def test_joint_and_drive_commands_are_noted_for_their_tick(machine: Machine) -> None:
    for topic, message, _ in ALL:
        machine.send(topic, message())
    assert machine.times.noted == [STAMP] * 3  # two of joint_commands, one of cmd_vel


def test_what_the_board_refuses_is_told_and_not_noted(machine: Machine) -> None:
    machine.receiver.refusal = "no such joint; name another"
    for topic, message, _ in ALL:
        machine.send(topic, message())
    assert machine.refused == [(topic, "no such joint; name another") for topic, _, _ in ALL]
    assert machine.times.noted == []


def test_without_a_run_all_but_the_emergency_stop_is_refused(machine: Machine) -> None:
    machine.running = False
    for topic, message, _ in ALL:
        machine.send(topic, message())
    assert machine.receiver.told == [("emergency_stop", True)]
    assert [topic for topic, _ in machine.refused] == [topic for topic, _, _ in ALL[:-1]]
    assert all("once it has joined" in reason for _, reason in machine.refused)


def test_a_publisher_that_does_its_best_only_is_heard(machine: Machine, ros: Ros) -> None:
    publisher = ros.publisher("/digger/cmd_vel", TwistStamped, COMMANDS, subscriptions=1)

    def heard() -> bool:
        publisher.publish(twist(1.0, 0.0))
        return bool(machine.receiver.told)

    ros.spin_until(heard)


def test_commands_that_have_arrived_are_taken_in_one_wake(machine: Machine, ros: Ros) -> None:
    publishers = [
        ros.publisher(f"/digger/{topic}", type(message()), subscriptions=1)
        for topic, message, _ in ALL
    ]
    for publisher, (_, message, _) in zip(publishers, ALL, strict=True):
        publisher.publish(message())
    ros.spin_until(lambda: len(machine.receiver.told) == len(ALL))
    assert machine.woken <= len(ALL)

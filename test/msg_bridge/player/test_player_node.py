"""Messages of a bag arrive as they were recorded, and late subscribers receive the map."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Int64MultiArray, String
from std_srvs.srv import SetBool

from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec import qos
from msg_bridge.player.params import PlayerParams
from msg_bridge.player.player_node import PlayerNode, PlayError
from msg_bridge.testing.ros_context import Ros

TEXTS, CONFIG, TICKS = "/texts", "/sim/config", "/soil/tick"
SECOND = 10**9
DEEP_TRANSIENT_LOCAL = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag of 3 s: 300 texts, and a configuration that the recorder repeated."""
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic(TEXTS, "std_msgs/msg/String", [OfferedQos()])
    writer.add_topic(TICKS, "std_msgs/msg/Int64MultiArray", [OfferedQos()])
    transient_local = OfferedQos(durability="transient_local")
    writer.add_topic(CONFIG, "std_msgs/msg/String", [transient_local])
    config = serialize_message(String(data="first"))
    for number in range(300):
        time = 50 * SECOND + number * SECOND // 100
        if number == 200:
            config = serialize_message(String(data="second"))
        if number % 50 == 0:
            writer.write(CONFIG, config, time, time)
        writer.write(TEXTS, serialize_message(String(data=str(number))), time, time, number)
    writer.write(TICKS, serialize_message(Int64MultiArray(data=[2])), time, time)
    writer.close()
    return writer.folder


def play(ros: Ros, bag: Path, **params) -> PlayerNode:
    return ros.add(PlayerNode, bag, PlayerParams(**params))


def test_messages_arrive_in_order_and_once(ros: Ros, bag: Path) -> None:
    texts = ros.collect(TEXTS, String)
    configs = ros.collect(CONFIG, String, qos.TRANSIENT_LOCAL)
    clocks = ros.collect("/clock", Clock, qos.STATE)
    player = play(ros, bag, rate=3.0)
    ros.spin_until(lambda: player.finished)
    ros.spin_until(lambda: len(texts) == 300)
    assert [int(message.data) for message in texts] == list(range(300))
    assert [message.data for message in configs] == ["first", "second"]
    times = [message.clock.sec + 1e-9 * message.clock.nanosec for message in clocks]
    assert times == sorted(times)
    assert (times[0], times[-1]) == pytest.approx((50.0, 53.0), abs=0.3)
    late = ros.collect(CONFIG, String, DEEP_TRANSIENT_LOCAL)
    ros.spin_until(lambda: bool(late))
    ros.spin_for(0.1)
    assert [message.data for message in late] == ["second"]
    status = player.status()
    assert (status["position"], status["is_finished"]) == (2.99, True)
    player.stop()


def test_player_is_controlled_by_services_and_topics(ros: Ros, bag: Path) -> None:
    texts = ros.collect(TEXTS, String)
    configs = ros.collect(CONFIG, String, qos.TRANSIENT_LOCAL)
    statuses = ros.collect("/bag_player/status", String, qos.TRANSIENT_LOCAL)
    player = play(ros, bag, paused=True, prefix="")
    seek = ros.publisher("/bag_player/seek", Float64, subscriptions=1)
    seek.publish(Float64(data=2.5))
    ros.spin_until(lambda: [message.data for message in configs] == ["second"])
    assert texts == []
    ros.call(SetBool, "/bag_player/pause", SetBool.Request(data=False))
    ros.spin_until(lambda: player.finished)
    ros.spin_until(lambda: len(texts) == 50)
    assert [int(message.data) for message in texts] == list(range(250, 300))
    ros.spin_until(lambda: json.loads(statuses[-1].data)["is_finished"])
    player.stop()


def test_begin_after_the_end_of_the_bag_is_rejected(ros: Ros, bag: Path) -> None:
    with pytest.raises(PlayError, match=r"--start 3: .* has 0 to 2\.99 s"):
        play(ros, bag, start=3.0)


def test_topics_of_a_running_simulation_are_not_mixed(ros: Ros, bag: Path) -> None:
    ros.publisher(TICKS, Int64MultiArray)
    player = play(ros, bag)
    with pytest.raises(PlayError, match=r"/soil/tick.*--prefix"):
        ros.spin_until(lambda: player.finished)
    ros.remove(player)
    player.stop()
    texts = ros.collect("/recorded/texts", String)
    player = play(ros, bag, prefix="recorded", exclude="^/soil", rate=10.0)
    ros.spin_until(lambda: player.finished)
    ros.spin_until(lambda: len(texts) == 300)
    player.stop()


@pytest.mark.parametrize(("mode", "seconds"), [("auto", {7}), ("log", {50}), ("none", set())])
def test_clock_is_recorded_or_made_from_log_times(
    ros: Ros, tmp_path: Path, mode: str, seconds: set[int]
) -> None:
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/clock", "rosgraph_msgs/msg/Clock", [OfferedQos()])
    for number in range(30):
        clock = serialize_message(Clock(clock=Time(sec=7, nanosec=number)))
        time = 50 * SECOND + number * SECOND // 100
        writer.write("/clock", clock, time, time)
    writer.add_topic(TEXTS, "std_msgs/msg/String", [OfferedQos()])
    writer.write(TEXTS, serialize_message(String(data="last")), time, time)
    writer.close()
    clocks = ros.collect("/clock", Clock, qos.STATE)
    texts = ros.collect(TEXTS, String)
    player = play(ros, tmp_path / "bag", clock=mode)
    ros.spin_until(lambda: player.finished and bool(texts))
    ros.spin_for(0.1)
    assert {message.clock.sec for message in clocks} == seconds
    player.stop()


def test_damaged_messages_are_left_out_and_counted(ros: Ros, tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/value", "std_msgs/msg/Float64", [OfferedQos()])
    for number in range(20):
        data = serialize_message(Float64(data=float(number)))
        time = 50 * SECOND + number * SECOND // 100
        writer.write("/value", data + bytes(5000) if number in (7, 8) else data, time, time)
    writer.close()
    values = ros.collect("/value", Float64)
    player = play(ros, tmp_path / "bag")
    ros.spin_until(lambda: player.finished and len(values) == 18)
    assert {message.data for message in values} == set(range(20)) - {7, 8}
    assert player.status()["damaged_messages"] == 2
    player.stop()

"""Bags contain the selected messages, unchanged, with QoS, order and times."""

import array
import sys

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, String
from support.recorder_scenes import (
    LARGE,
    num_recorded,
    publish,
    read_bag,
    records_of,
    spin_until_recorded,
    texts,
)

from msg_bridge.codec import qos


def test_bag_contains_every_published_message(ros, recorder, tmp_path):
    sent = {
        "/t/texts": (LARGE, texts(0, 99)),
        "/t/numbers": (
            qos.COMMANDS,
            [Float64MultiArray(data=array.array("d", [i, 0.5])) for i in range(5)],
        ),
        "/t/transient_local": (qos.TRANSIENT_LOCAL, [String(data="only")]),
        "/t/points": (LARGE, [PointStamped(), PointStamped()]),
    }
    node = recorder(repeat_transient_local_period=0.0)
    for topic, (profile, messages) in sent.items():
        publish(ros.publisher(topic, type(messages[0]), profile, subscriptions=1), messages)
    spin_until_recorded(ros, node, sum(len(messages) for _, messages in sent.values()))
    node.stop()

    assert read_bag(tmp_path / "dig") == {topic: each for topic, (_, each) in sent.items()}
    assert [each.sequence for each in records_of(tmp_path / "dig", "/t/texts")] == [*range(1, 101)]
    with AnyReader([tmp_path / "dig"]) as reader:
        of_texts = [each for each in reader.connections if each.topic == "/t/texts"]
        read = [reader.deserialize(d, c.msgtype).data for c, _, d in reader.messages(of_texts)]
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        decoding = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [each.data for *_, each in decoding.iter_decoded_messages("/t/texts")]
    assert read == decoded == [f"text {i}" for i in range(100)]


def test_bytes_are_not_changed(ros, recorder, tmp_path):
    node = recorder()
    raw: list[bytes] = []
    ros.helper.create_subscription(String, "/t/texts", raw.append, LARGE, raw=True)
    publish(ros.publisher("/t/texts", String, LARGE, subscriptions=2), texts(1, 50))
    ros.spin_until(lambda: len(raw) == 50)
    spin_until_recorded(ros, node, 50)
    node.stop()
    assert [each.data for each in records_of(tmp_path / "dig", "/t/texts")] == raw


def test_offered_qos_is_recorded(ros, recorder, tmp_path):
    node = recorder()
    for topic, profile in (
        ("/t/transient_local", qos.TRANSIENT_LOCAL),
        ("/t/best_effort", qos.COMMANDS),
    ):
        ros.publisher(topic, String, profile, subscriptions=1)
    node.stop()
    with Reader(tmp_path / "dig") as reader:
        offered = {each.topic: each.ext.offered_qos_profiles for each in reader.connections}
    ((transient_local,), (best_effort,)) = offered["/t/transient_local"], offered["/t/best_effort"]
    assert transient_local.durability is QosDurability.TRANSIENT_LOCAL
    assert transient_local.reliability is QosReliability.RELIABLE
    assert best_effort.durability is QosDurability.VOLATILE
    assert best_effort.reliability is QosReliability.BEST_EFFORT


def test_all_topics_are_recorded_by_default(ros, recorder, tmp_path):
    node = recorder(include="")
    talker = ros.node("talker")
    ros.spin_until(lambda: "/rosout" in node.recording.topics)
    ros.spin_until(lambda: "/parameter_events" in node.recording.topics)
    talker.declare_parameter("new", 1)
    talker.get_logger().info("hello")
    ros.spin_until(lambda: num_recorded(node) >= 2)
    ros.spin_until(lambda: "/recorder/status" in node.recording.topics)
    ros.spin_until(lambda: "/diagnostics" in node.recording.topics)
    node.stop()
    recorded = read_bag(tmp_path / "dig")
    assert "/talker" in [each.node for each in recorded["/parameter_events"]]
    assert "hello" in [each.msg for each in recorded["/rosout"]]


def test_only_selected_topics_are_recorded(ros, recorder, tmp_path):
    node = recorder(include="^/t/|/map$", exclude="image")
    for topic in ("/t/camera/image", "/t/a", "/terrain/map", "/other"):
        ros.publisher(topic, String)
    ros.spin_until(lambda: len(node.recording.topics) == 2)
    ros.spin_for(0.3)
    assert sorted(node.recording.topics) == ["/t/a", "/terrain/map"]
    node.stop()


def test_transient_local_message_from_before_the_recorder_is_in_the_bag(ros, recorder, tmp_path):
    publish(ros.publisher("/t/transient_local", String, qos.TRANSIENT_LOCAL), texts(1, 2))
    node = recorder()
    spin_until_recorded(ros, node, 1)
    node.stop()
    assert read_bag(tmp_path / "dig") == {"/t/transient_local": texts(2, 2)}


def test_transient_local_messages_are_written_again(ros, recorder, tmp_path):
    publish(ros.publisher("/t/transient_local", String, qos.TRANSIENT_LOCAL), texts(1, 1))
    publish(ros.publisher("/t/volatile", String, qos.ROWS), texts(1, 1))
    node = recorder(repeat_transient_local_period=0.1)
    spin_until_recorded(ros, node, 1)
    ros.spin_for(0.55)
    node.stop()
    repeated = records_of(tmp_path / "dig", "/t/transient_local")
    assert 4 <= len(repeated) <= 7
    steps = np.diff([each.log_time for each in repeated])
    assert (steps >= 1e8).all()
    identities = {(each.data, each.publish_time, each.sequence) for each in repeated}
    assert len(identities) == 1  # distinguishes repetitions from new messages
    assert records_of(tmp_path / "dig", "/t/volatile") == []
    assert num_recorded(node) == 1


def test_only_the_newest_transient_local_message_is_written_again(ros, recorder, tmp_path):
    publisher = ros.publisher("/t/transient_local", String, qos.TRANSIENT_LOCAL)
    node = recorder(repeat_transient_local_period=0.1)
    ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    publish(publisher, texts(1, 3))
    spin_until_recorded(ros, node, 3)
    ros.spin_for(0.15)
    node.stop()
    recorded = [each.sequence for each in records_of(tmp_path / "dig", "/t/transient_local")]
    assert recorded[:3] == [1, 2, 3]
    assert set(recorded[3:]) == {3}


@pytest.mark.parametrize(("topic", "repeated"), [("/sim/config", {"2"}), ("/t/a", {"1", "2"})])
def test_message_of_a_killed_publisher_is_not_written_again(
    ros, recorder, tmp_path, topic, repeated
):
    """A node that was killed counts as a publisher for some seconds after it was restarted."""
    node = recorder(include=topic, repeat_transient_local_period=0.1)
    publishers = [ros.publisher(topic, String, qos.TRANSIENT_LOCAL) for _ in range(2)]
    ros.spin_until(lambda: all(each.get_subscription_count() >= 1 for each in publishers))
    for number, publisher in enumerate(publishers, 1):
        publisher.publish(String(data=str(number)))
        spin_until_recorded(ros, node, number)
    ros.spin_for(0.35)
    node.stop()
    written = [each.data.decode("latin1") for each in records_of(tmp_path / "dig", topic)][2:]
    assert {each for each in "12" if any(each in text for text in written)} == repeated


def test_publisher_with_weaker_qos_than_the_others_is_recorded(ros, recorder, tmp_path):
    node = recorder(repeat_transient_local_period=0.0)
    transient_local = ros.publisher("/t/mixed", String, qos.TRANSIENT_LOCAL, subscriptions=1)
    best_effort = ros.publisher("/t/mixed", String, qos.COMMANDS, subscriptions=1)
    ros.spin_until(lambda: transient_local.get_subscription_count() == 1)
    publish(transient_local, texts(1, 1))
    publish(best_effort, texts(2, 2))
    spin_until_recorded(ros, node, 2)
    node.stop()
    recorded = read_bag(tmp_path / "dig")["/t/mixed"]
    assert sorted(each.data for each in recorded) == ["text 1", "text 2"]


def test_topic_of_a_type_that_is_not_installed_is_skipped_with_one_warning(
    ros, recorder, tmp_path, monkeypatch, capfd
):
    ros.publisher("/t/unknown", PointStamped)
    monkeypatch.setitem(sys.modules, "geometry_msgs.msg", None)  # imports of it fail
    node = recorder()
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 1))
    spin_until_recorded(ros, node, 1)
    ros.spin_for(0.5)
    node.stop()
    assert list(read_bag(tmp_path / "dig")) == ["/t/texts"]
    output = capfd.readouterr()
    assert (output.out + output.err).count("/t/unknown is not received") == 1


@pytest.mark.parametrize("include", ["^/t/", "^/t/|^/clock"])
def test_log_time_is_the_last_clock_with_simulation_time(ros, recorder, tmp_path, include):
    node = recorder(use_sim_time=True, include=include)
    clock = ros.publisher("/clock", Clock, qos.STATE, subscriptions=2)  # one is the node's own
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 2))
    ros.spin_for(0.1)
    for second in (50, 51, 52):
        publish(clock, [Clock(clock=Time(sec=second, nanosec=5))])
        publish(publisher, texts(second, second))
    spin_until_recorded(ros, node, 5 + 3 * ("clock" in include))
    node.stop()
    recorded = records_of(tmp_path / "dig", "/t/texts")
    seconds = [divmod(each.log_time, 10**9) for each in recorded]
    assert seconds == [
        (50, 5),
        (50, 5),
        (50, 5),
        (51, 5),
        (52, 5),
    ]  # two before /clock
    assert len(records_of(tmp_path / "dig", "/clock")) == 3 * ("clock" in include)


def test_messages_are_written_in_the_order_of_reception(ros, recorder, tmp_path):
    node = recorder()
    publishers = [
        ros.publisher(f"/t/{name}", String, LARGE, subscriptions=1) for name in ("b", "a", "c")
    ]
    for i in range(100):
        publish(publishers[i % 3], [String(data=str(i))])
    spin_until_recorded(ros, node, 100)
    node.stop()
    with AnyReader([tmp_path / "dig"]) as reader:
        read = [int(reader.deserialize(d, c.msgtype).data) for c, _, d in reader.messages()]
    assert read == list(range(100))


def test_wait_for_the_first_clock_is_reported(ros, recorder) -> None:
    node = recorder(use_sim_time=True)
    ros.spin_until(lambda: "first message on /clock" in node.diagnostics.report().message)
    clock = ros.publisher("/clock", Clock, subscriptions=1)

    def is_over() -> bool:
        clock.publish(Clock())
        return node.diagnostics.report().values["waiting_for"] == "nothing"

    ros.spin_until(is_over)

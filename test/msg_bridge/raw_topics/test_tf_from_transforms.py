"""`/tf` made from the transforms of machines, live and in bags."""

import sys

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Header, Int64MultiArray, String
from support.recorder_scenes import LARGE, publish, spin_until_recorded

from msg_bridge.bag.bundled_types import TF_TYPE
from msg_bridge.bag.reader import BagReader, BagReadError
from msg_bridge.codec import qos
from msg_bridge.codec.tf_message import read_transform, tf_message_to_cdr

STORE = get_typestore(Stores.ROS2_JAZZY)


def transform(child: str, stamp: int, x: float) -> TransformStamped:
    """Return a transform from the map, `x` [m] ahead, at a time [s]."""
    return TransformStamped(
        header=Header(stamp=Time(sec=stamp), frame_id="map"),
        child_frame_id=child,
        transform=Transform(
            translation=Vector3(x=x, y=-2.0, z=0.5), rotation=Quaternion(x=0.0, z=0.6, w=0.8)
        ),
    )


def frames_and_places(*tf_messages) -> list[tuple[str, int, float]]:
    return [
        (each.child_frame_id, each.header.stamp.sec, each.transform.translation.x)
        for message in tf_messages
        for each in message.transforms
    ]


@pytest.mark.parametrize("children", [["a"], ["ab", "abc", "abcd", "abcde/fghijkl"], []])
def test_serialised_tf_message_has_the_transforms(children):
    sent = [transform(child, 5, float(i)) for i, child in enumerate(children)]
    parts = [read_transform(serialize_message(each)) for each in sent]
    decoded = STORE.deserialize_cdr(tf_message_to_cdr(parts), TF_TYPE)
    assert frames_and_places(decoded) == [
        (each.child_frame_id, 5, each.transform.translation.x) for each in sent
    ]
    assert all(each.header.frame_id == "map" for each in decoded.transforms)
    assert all(each.transform.rotation.w == 0.8 for each in decoded.transforms)


def test_message_that_is_cut_short_is_not_a_transform():
    data = serialize_message(transform("a/base_link", 5, 1.0))
    assert read_transform(data) is not None
    assert all(read_transform(data[:size]) is None for size in range(len(data)))


def send_transforms(ros, topic: str) -> None:
    publisher = ros.publisher(topic, TransformStamped, LARGE, subscriptions=1)
    sent = [
        transform(child, stamp, float(stamp)) for stamp in (1, 2) for child in ("base_link", "boom")
    ]
    publish(publisher, sent)


def test_bag_has_tf_that_independent_readers_decode(ros, recorder, tmp_path):
    node = recorder(include="^/t/|^/tf$")
    send_transforms(ros, "/t/transforms")
    spin_until_recorded(ros, node, 4)
    ros.spin_until(lambda: "/tf" in node.recording.topics)
    node.stop()
    expected = [(child, stamp, stamp) for stamp in (1, 2) for child in ("base_link", "boom")]
    with AnyReader([tmp_path / "dig"]) as reader:
        of_tf = [each for each in reader.connections if each.topic == "/tf"]
        messages = [reader.deserialize(d, c.msgtype) for c, _, d in reader.messages(of_tf)]
    assert frames_and_places(*messages) == expected
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        decoding = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [message for *_, message in decoding.iter_decoded_messages("/tf")]
    assert frames_and_places(*decoded) == expected
    with Reader(tmp_path / "dig") as reader:
        (connection,) = (each for each in reader.connections if each.topic == "/tf")
    assert (connection.msgtype, connection.digest) == (TF_TYPE, STORE.hash_rihs01(TF_TYPE))


def test_reader_of_this_package_leaves_out_tf_without_its_package(
    ros, recorder, tmp_path, monkeypatch
):
    node = recorder(include="^/t/|^/tf$")
    send_transforms(ros, "/t/transforms")
    spin_until_recorded(ros, node, 5)
    node.stop()
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    reader = BagReader(tmp_path / "dig")
    assert {topic for topic, _, _ in reader} == {"/t/transforms"}
    with pytest.raises(BagReadError, match="tf2_msgs"):
        next(reader.messages(["/tf"]))


@pytest.mark.parametrize(
    "parameters", [{"make_tf": False, "include": "^/t/|^/tf$"}, {"include": "^/t/"}]
)
def test_tf_is_not_made_if_it_is_not_selected(ros, recorder, parameters):
    node = recorder(**parameters)
    send_transforms(ros, "/t/transforms")
    spin_until_recorded(ros, node, 4)
    node.stop()
    assert node.recording.topics == ("/t/transforms",)


@pytest.mark.parametrize(
    ("machine_node", "machine", "tf_topic"),
    [
        ("/site/digger", "/site/digger", "/site/tf"),
        ("/site/fleet", "/site/fleet/left", "/site/tf"),
        ("/digger", "/digger", "/tf"),
    ],
)
def test_tf_is_in_the_namespace_of_the_simulation(ros, recorder, machine_node, machine, tf_topic):
    ros.publisher(f"{machine_node}/soil_tick", Int64MultiArray)
    node = recorder(include="")
    send_transforms(ros, f"{machine}/transforms")
    ros.spin_until(lambda: any(each.endswith("/tf") for each in node.recording.topics))
    assert [each for each in node.recording.topics if each.endswith("/tf")] == [tf_topic]
    node.stop()


def test_published_tf_is_recorded_and_not_made(ros, recorder, tmp_path):
    # Of another type, because tf2_msgs may be missing here.
    ros.publisher("/tf", String, qos.TRANSIENT_LOCAL).publish(String(data="published"))
    node = recorder(include="^/t/|^/tf$")
    ros.spin_until(lambda: "/tf" in node.recording.topics)
    send_transforms(ros, "/t/transforms")
    spin_until_recorded(ros, node, 5)
    node.stop()
    with Reader(tmp_path / "dig") as reader:
        assert {each.topic: each.msgcount for each in reader.connections} == {
            "/tf": 1,
            "/t/transforms": 4,
        }

"""Bytes that are no message, truncated messages and very long texts are rejected."""

from __future__ import annotations

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray
from support.node_scenes import Scene

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.tick_headers import message_to_cdr, to_multi_array
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, Stream, Verb
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk
from msg_bridge.testing.ros_context import Ros

HEAD = b"\x00\x01\x00\x00"
LEDGER = Ledger(3, 4, 9, 0, 0, 0, 0, 0, 9)
HEADER = MachineHeader(run_id=3, machine_id=1, session_id=2, tick=4, verb=Verb.STEP)

MALFORMED = {
    "nothing": b"",
    "no body": HEAD,
    "cut short": HEAD + b"\x01\x00\x00\x00\x05\x00",
    "lengths without end": HEAD + b"\xff" * 64,
    "another byte order": b"\x00\x00\x00\x00" + b"\x00" * 7 + b"\x01",
}


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED.keys())
def test_malformed_bytes_are_rejected(data: bytes) -> None:
    with pytest.raises(CodecError):
        decode_array(data)
    with pytest.raises(CodecError):
        decode_chunk(data, Stream.SWEEP)


def test_truncated_messages_are_rejected() -> None:
    complete = message_to_cdr(HEADER)
    assert decode_array(complete) == HEADER
    for size in range(len(complete)):
        with pytest.raises(CodecError):
            decode_array(complete[:size])
    cloud = serialize_message(PointCloud2())
    for size in range(len(cloud) + 1):
        with pytest.raises(CodecError):
            decode_chunk(cloud[:size], Stream.DEPOSIT_REQUEST)


def test_node_continues_after_malformed_messages(ros: Ros) -> None:
    scene = Scene(ros)
    machine = scene.machine()
    scene.until_tick(3)
    for node, topic in ((scene.soil, "/excavator/soil_tick"), (machine, "/soil/tick")):
        publisher = ros.publisher(topic, Int64MultiArray, subscriptions=1)
        for data in MALFORMED.values():
            publisher.publish(data)
        key = f"rejected {topic}"
        scene.until_shown(node, key, len(MALFORMED))
        publisher.publish(to_multi_array(LEDGER))
        scene.until_shown(node, key, len(MALFORMED) + 1)
        assert scene.shown(node)[f"last {key}"].startswith(ErrorCode.STREAM_DIRECTION)
    scene.more_ticks(5)


def test_long_rejection_reason_is_shortened(ros: Ros) -> None:
    diagnostics = Diagnostics(ros.node())
    message = to_multi_array(HEADER)
    message.layout.dim[0].label = "x" * 1_000_000
    with pytest.raises(CodecError) as error:
        decode_array(serialize_message(message))
    diagnostics.reject("/soil/tick", str(error.value))
    shown = diagnostics.report().values["last rejected /soil/tick"]
    assert "label" in shown
    assert len(shown) < 1000

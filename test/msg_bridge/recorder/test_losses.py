"""Losses of messages and rows are counted, and nothing else is."""

import json

import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from support.recorder_scenes import LARGE, publish, spin_until_recorded, texts

from msg_bridge.codec import qos
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import SWEEP, empty_rows


def test_messages_that_overrun_the_recorder_are_counted(ros, recorder, tmp_path):
    node = recorder()
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 1))
    spin_until_recorded(ros, node, 1)
    publish(publisher, texts(2, 1500))  # without spinning in between
    spin_until_recorded(ros, node, 1001)
    ros.spin_until(lambda: node.recording.loss_counter.total > 0)
    assert node.recording.loss_counter.lost == {"/t/texts": 499}
    node.stop()
    metadata = yaml.safe_load((tmp_path / "dig/metadata.yaml").read_text())
    custom = metadata["rosbag2_bagfile_information"]["custom_data"]
    assert json.loads(custom["lost"]) == {"/t/texts": 499}


def test_publishers_that_start_end_or_restart_cause_no_losses(ros, recorder, tmp_path):
    node = recorder()
    keeper = ros.publisher("/t/shared", String, LARGE, subscriptions=1)
    count = 0
    for turn in range(3):
        restarted = ros.node(f"restarted_{turn}")
        for topic in ("/t/shared", "/t/own"):
            publisher = restarted.create_publisher(String, topic, LARGE)
            publish(publisher, texts(1, 40))  # numbers 1 to 40; late subscribers receive the rest
            ros.spin_until(lambda p=publisher: p.get_subscription_count() == 1)
            publish(publisher, texts(41, 50))
            publish(keeper, texts(1, 5))
            count += 15
        spin_until_recorded(ros, node, count)
        ros.remove(restarted)
    ros.spin_for(0.5)  # two checks of the graph
    publish(keeper, texts(1, 5))
    ros.spin_for(0.3)
    node.stop()
    assert node.recording.loss_counter.lost == {}


def test_missing_rows_are_counted_until_they_are_sent_again(ros, recorder):
    node = recorder()
    first, second = (
        ros.publisher("/t/sweeps", PointCloud2, qos.ROWS, subscriptions=1) for _ in range(2)
    )

    def send(publisher, seq: range, machine_id: int) -> None:
        rows = empty_rows(SWEEP, len(seq))
        rows["seq"], rows["machine_id"] = seq, machine_id
        chunk = RowChunk(7, Stream.SWEEP, machine_id, 1, rows)
        publisher.publish(to_chunk_cloud(chunk, "map", Time()))

    for start in (1, 11, 31):
        send(first, range(start, start + 10), machine_id=1)
        send(second, range(5 * start, 5 * start + 50), machine_id=2)
    spin_until_recorded(ros, node, 6)
    assert node.recording.loss_counter.lost == {"/t/sweeps": 10 + 50}
    send(first, range(21, 31), machine_id=1)
    spin_until_recorded(ros, node, 7)
    assert node.recording.loss_counter.lost == {"/t/sweeps": 50}
    node.stop()


def test_status_and_diagnostics_report_losses(ros, recorder, tmp_path):
    node = recorder()
    diagnostics = ros.collect("/diagnostics", DiagnosticArray)
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 1))
    spin_until_recorded(ros, node, 1)
    publish(publisher, texts(2, 1101))
    ros.spin_until(lambda: node.recording.loss_counter.total > 0)
    ros.spin_until(lambda: diagnostics and diagnostics[-1].status[0].level == b"\x01")
    status = diagnostics[-1].status[0]
    assert status.message == "lost 100 on /t/texts"
    assert {each.key: each.value for each in status.values}["messages"] == "1001"
    statuses = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: statuses and json.loads(statuses[-1].data)["num_lost"] > 0)
    size = sum(len(serialize_message(each)) for each in [*texts(1, 1), *texts(102, 1101)])
    status = json.loads(statuses[-1].data)
    assert size <= status.pop("bytes") < size + 1001 * 4  # the middleware pads
    assert status.pop("bytes_queued") >= 0
    assert 0 <= status.pop("messages_in_file") <= 1001
    assert 0 < status.pop("bytes_on_disk") <= (tmp_path / "dig/dig_0.mcap").stat().st_size
    assert status == {
        "path": str(tmp_path / "dig"),
        "files": 1,
        "topics": 1,
        "messages": 1001,
        "num_lost": 100,
        "lost": {"/t/texts": 100},
        "uncounted": [],
        "input_files": 0,
        "missing_files": {},
    }
    node.stop()

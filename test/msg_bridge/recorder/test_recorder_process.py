"""A recorder process leaves a readable bag however it ends."""

import json
import os
import signal
import sys
import textwrap

from std_msgs.msg import String
from support.recorder_scenes import LARGE, decoded_texts, publish, read_bag, records_of, texts

from msg_bridge.codec import qos

RECORDER = [sys.executable, "-m", "msg_bridge.recorder.recorder_node"]


# The recorder as a process that may write files of argv[1] bytes.
LIMITED = """\
import resource, sys
from msg_bridge.recorder.recorder_node import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
sys.exit(main())
"""


def has_recorded(status: list[String], count: int) -> bool:
    return bool(status) and json.loads(status[-1].data)["messages_in_file"] >= count


def test_terminated_process_leaves_a_complete_bag(ros, ros_process, tmp_path):
    process = ros_process(
        [*RECORDER, "--ros-args", "-p", f"path:={tmp_path}/dig", "-p", "include:=^/t/"]
    )
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 500))
    publisher.wait_for_all_acked()
    process.stop(signal.SIGTERM, expect=0)
    assert read_bag(tmp_path / "dig") == {"/t/texts": texts(1, 500)}
    last = process.output.splitlines()[-1]
    assert last.startswith(f"{tmp_path}/dig: 500 messages on 1 topic,")
    assert last.endswith("nothing lost")


def test_killed_process_leaves_all_messages_of_its_last_status(ros, ros_process, tmp_path):
    process = ros_process(RECORDER, parameters={"path": str(tmp_path / "dig"), "include": "^/t/"})
    status = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 200))
    ros.spin_until(lambda: has_recorded(status, 200))
    process.kill()
    assert decoded_texts(records_of(tmp_path / "dig", "/t/texts")) == texts(1, 200)
    assert not (tmp_path / "dig/metadata.yaml").exists()


def test_unknown_parameter_creates_no_bag(ros_process, tmp_path):
    process = ros_process(RECORDER, parameters={"path": str(tmp_path / "dig"), "output": "x"})
    process.wait(expect=2)
    assert not (tmp_path / "dig").exists()


def test_process_has_the_niceness_of_its_parameter(ros, ros_process, tmp_path):
    process = ros_process(RECORDER, parameters={"path": str(tmp_path / "dig"), "niceness": 3})
    status = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: has_recorded(status, 0))
    own = os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, process.pid) == min(own + 3, 19)


def test_full_disk_ends_the_process_with_an_error_message(ros, ros_process, tmp_path):
    script = tmp_path / "limited.py"
    script.write_text(textwrap.dedent(LIMITED))
    process = ros_process(
        [sys.executable, script, "20000"],
        parameters={"path": str(tmp_path / "dig"), "include": "^/t/", "compression": "none"},
    )
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 100))
    status = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: has_recorded(status, 100))
    publish(publisher, [String(data=30_000 * "x")])
    process.wait(expect=2)
    last = process.output.splitlines()[-1]
    assert last.startswith("exchange_recorder: there is no disk space for")
    assert sum("no disk space" in line for line in process.output.splitlines()) == 1
    assert decoded_texts(records_of(tmp_path / "dig", "/t/texts")) == texts(1, 100)


def test_invalid_path_ends_the_process_with_an_error_message(ros_process, tmp_path):
    (tmp_path / "file").touch()
    process = ros_process(RECORDER, parameters={"path": str(tmp_path / "file/dig")})
    process.wait(expect=2)
    assert "file/dig cannot be written" in process.output

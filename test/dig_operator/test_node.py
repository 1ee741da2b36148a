"""The operator node: works with a machine in lockstep by public topics alone."""

from __future__ import annotations

import json
import math
import time
from typing import Any

import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Int64MultiArray, String
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import TICK, Scene

from dig_operator.node import DigOperatorNode
from msg_bridge.codec import qos
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.testing.ros_context import Ros

COMMAND_PERIOD = 2
"""Ticks between two commands."""


def start_operator(ros: Ros, **parameters: Any) -> tuple[Scene, DigOperatorNode]:
    """Start an operator and a machine that waits for its commands."""
    scene = Scene(ros)
    scene.machine(command_wait_period=COMMAND_PERIOD)
    options = {"task.approach_distance": 0.2, **parameters}
    return scene, ros.add(DigOperatorNode, parameters=options)


def ticks_of(messages: list[JointState]) -> list[int]:
    return [tick_from_stamp(message.header.stamp, TICK) for message in messages]


def test_each_command_has_the_stamp_of_its_state(ros: Ros) -> None:
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene, _ = start_operator(ros)
    scene.until_tick(60)
    assert list(commands[0].name) == list(COMMAND_NAMES)
    ticks = ticks_of(commands)
    assert ticks == sorted(ticks)  # commands may be repeated
    assert set(ticks) >= set(range(0, 60, COMMAND_PERIOD))


def test_operator_of_a_machine_without_payload_needs_no_payload_topic(ros: Ros) -> None:
    road_header = {"machine": "machines/road_header.yaml"}
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene = Scene(ros)
    scene.machine(command_wait_period=COMMAND_PERIOD, **road_header)
    ros.add(DigOperatorNode, parameters=road_header)
    scene.until_tick(20)
    assert list(commands[0].name) == ["turn", "lift", "head", "left_track", "right_track"]
    assert set(ticks_of(commands)) >= set(range(0, 20, COMMAND_PERIOD))


def test_each_command_is_applied_in_the_two_following_ticks(ros: Ros) -> None:
    applied = ros.collect("/excavator/applied_commands", JointState)
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene, _ = start_operator(ros)
    scene.until_tick(100)
    sent = {t: list(m.velocity) for t, m in zip(ticks_of(commands), commands, strict=True)}
    effective = {t: list(m.velocity) for t, m in zip(ticks_of(applied), applied, strict=True)}
    for tick in range(COMMAND_PERIOD, 100, COMMAND_PERIOD):
        assert effective[tick + 1] == effective[tick + 2] == sent[tick], tick
    assert any(any(velocity) for velocity in sent.values())


def test_machine_waits_without_an_operator(ros: Ros) -> None:
    scene = Scene(ros)
    scene.machine(command_wait_period=COMMAND_PERIOD)
    ros.spin_until(lambda: scene.tick == 0)
    ros.spin_for(0.4)
    assert scene.tick == 0
    operator = ros.add(DigOperatorNode)
    scene.until_tick(20)
    ros.remove(operator)
    ros.spin_for(0.3)
    last_tick = scene.tick
    ros.spin_for(0.3)
    assert scene.tick == last_tick


def test_phases_are_published_in_order(ros: Ros) -> None:
    phases = ros.collect("/excavator/operator/phase", String)
    _, operator = start_operator(ros)
    ros.spin_until(lambda: len(phases) >= 3)
    messages = [json.loads(message.data) for message in phases]
    assert [each["phase"] for each in messages[:3]] == ["approach", "brace", "reach"]
    assert {each["cycle"] for each in messages} == {1}
    times = [each["time"] for each in messages]
    assert times == sorted(times)
    assert not operator.finished


def test_exit_code_is_1_after_an_aborted_task(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    phases = ros.collect("/excavator/operator/phase", String)
    _, operator = start_operator(ros, **{"task.timeout": 1.0})
    ros.spin_until(lambda: operator.finished)
    assert operator.exit_code == 1
    ros.spin_until(lambda: json.loads(phases[-1].data)["phase"] == "done")
    assert json.loads(phases[-1].data)["abort_reason"] == operator.task.abort_reason != ""
    operator.stop()
    errors = [line for line in capfd.readouterr().err.splitlines() if "[ERROR]" in line]
    assert len(errors) == 1
    assert operator.task.abort_reason in errors[0]


def test_operator_without_soil_or_machine_logs_the_topic_that_it_waits_for(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    Scene(ros)
    ros.add(DigOperatorNode, namespace="/site/digger")
    right = {"simulation_namespace": "/"}
    ros.add(DigOperatorNode, namespace="/site/truck", parameters=right)
    output = ""

    def is_logged() -> bool:
        nonlocal output
        output += capfd.readouterr().err
        return all(f"waiting for {each}" in output for each in expected)

    expected = (
        "/site/sim/config; is `simulation_namespace`",
        "a tick with /site/truck/joint_states; does a machine_sim",
    )
    ros.spin_until(is_logged)


def test_reset_starts_the_task_again(ros: Ros) -> None:
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene, operator = start_operator(ros)
    ros.spin_until(lambda: operator.task.phase == "reach")
    first = operator.task
    scene.trigger("/sim/reset")
    ros.spin_until(lambda: operator.task is not first)
    del commands[:]
    scene.until_tick(10)
    assert operator.task.phase == "approach"
    ros.spin_until(lambda: operator.task.phase == "reach")
    assert scene.joined == (1,)


def test_task_continues_after_a_pause(ros: Ros) -> None:
    scene, operator = start_operator(ros)
    scene.until_tick(10)
    scene.pause()
    ros.spin_for(0.3)
    scene.pause(False)
    ros.spin_until(lambda: operator.task.phase == "reach")


def test_operator_works_in_real_time(ros: Ros) -> None:
    applied = ros.collect("/excavator/applied_commands", JointState)
    scene = Scene(ros, sync="realtime", machine_timeout=20.0)
    scene.machine()
    ros.add(DigOperatorNode)
    ros.spin_until(lambda: any(any(message.velocity) for message in applied))


NAMES = ["swing", "boom", "arm", "bucket"]
INVALID = [
    ("joint_states", JointState(name=["swing"], position=[0.0, 1.0])),
    ("joint_states", JointState(name=["swing"], position=[0.0])),
    ("joint_states", JointState(name=NAMES, position=[0.0, math.nan, 0.0, 0.0])),
    ("odom", Odometry()),
    ("payload", Float64MultiArray(data=[1.0])),
    ("/soil/ledger", Int64MultiArray(data=[1])),
    ("/sim/config", String(data="{}")),
]


def test_invalid_messages_are_counted_and_ignored(ros: Ros) -> None:
    scene, operator = start_operator(ros)
    scene.until_tick(4)
    counts: dict[str, int] = {}
    for topic, message in INVALID:
        name = topic if topic.startswith("/") else f"/excavator/{topic}"
        profile = qos.TRANSIENT_LOCAL if topic == "/sim/config" else qos.ROWS
        publisher = ros.publisher(name, type(message), profile, subscriptions=1)
        publisher.publish(message)
        key, counts[topic] = f"rejected {topic}", counts.get(topic, 0) + 1
        count = str(counts[topic])
        ros.spin_until(
            lambda key=key, count=count: operator.diagnostics.report().values.get(key) == count
        )
        ros.helper.destroy_publisher(publisher)
    last_tick = scene.tick
    ros.spin_until(lambda: scene.tick >= last_tick + 20)


@pytest.mark.slow
def test_operator_digs_one_bucketful_and_reports_it(ros: Ros) -> None:
    cycles = ros.collect("/excavator/operator/cycles", String)
    scene, operator = start_operator(ros, **{"task.cycles": 1})
    ros.spin_until(lambda: operator.finished, timeout=250.0)
    assert operator.exit_code == 0
    ros.spin_until(lambda: cycles)
    report = json.loads(cycles[0].data)
    assert report["number"] == 1
    assert report["moved_volume"] > 0.3
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
    assert scene.trigger("/soil/verify").success


# Silent and restarted peers.


def until_waiting(ros: Ros, scene: Scene, operator: DigOperatorNode, what: str) -> None:
    """Spin until the operator reports that it waits for something."""
    ros.spin_until(lambda: what in scene.shown(operator).get("waiting_for", ""), what=what)
    assert scene.shown(operator)["level"] == "1"


def test_operator_reports_a_silent_soil_and_a_silent_machine(ros: Ros) -> None:
    scene = Scene(ros, sync="realtime", machine_timeout=20.0)
    machine = scene.machine()
    operator = ros.add(DigOperatorNode)
    scene.until_tick(20)
    for node, what in (
        (scene.soil, "messages of the soil on /soil/ledger"),
        (machine, "messages of the machine on /excavator/joint_states"),
    ):
        ros.executor.remove_node(node)  # its process is suspended
        until_waiting(ros, scene, operator, what)
        ros.executor.add_node(node)
        scene.until_shown(operator, "waiting_for", "nothing")


@pytest.mark.parametrize("x", [0.0, 4.0])
def test_operator_aborts_when_its_machine_is_restarted(ros: Ros, x: float) -> None:
    scene = Scene(ros, sync="realtime")
    machine = scene.machine()
    operator = ros.add(DigOperatorNode)
    ros.spin_until(lambda: operator.task.phase == "approach" and scene.tick > 30)
    ros.remove(machine)  # killed
    now = int(time.time())
    ros.spin_until(lambda: int(time.time()) > now, what="a new session_id")
    scene.machine(x=x)
    ros.spin_until(lambda: operator.finished)
    assert operator.exit_code == 1
    assert "restarted" in operator.task.abort_reason

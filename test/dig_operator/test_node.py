"""The operator's node: takes turns with a machine by public topics alone."""

from __future__ import annotations

import json
import math
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

TURN = 2
"""Ticks between two commands."""


def working(ros: Ros, **parameters: Any) -> tuple[Scene, DigOperatorNode]:
    """An operator at the levers of a machine that waits for it."""
    scene = Scene(ros)
    scene.machine(command_wait_period=TURN)
    options = {"task.approach": 0.2, **parameters}
    return scene, ros.add(DigOperatorNode, parameters=options)


def ticks_of(messages: list[JointState]) -> list[int]:
    return [tick_from_stamp(message.header.stamp, TICK) for message in messages]


def test_each_command_answers_a_state_and_says_which(ros: Ros) -> None:
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene, _ = working(ros)
    scene.until_tick(60)
    assert list(commands[0].name) == list(COMMAND_NAMES)
    ticks = ticks_of(commands)
    assert ticks == sorted(ticks)  # one may be said again, none goes back
    assert set(ticks) >= set(range(0, 60, TURN))


def test_one_of_a_machine_that_holds_no_soil_needs_no_word_of_its_load(ros: Ros) -> None:
    kind = {"machine": "machines/road_header.yaml"}
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene = Scene(ros)
    scene.machine(command_wait_period=TURN, **kind)
    ros.add(DigOperatorNode, parameters=kind)
    scene.until_tick(20)
    assert list(commands[0].name) == ["turn", "lift", "head", "left_track", "right_track"]
    assert set(ticks_of(commands)) >= set(range(0, 20, TURN))


def test_machine_and_operator_take_turns(ros: Ros) -> None:
    applied = ros.collect("/excavator/applied_commands", JointState)
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene, _ = working(ros)
    scene.until_tick(100)
    said = {t: list(m.velocity) for t, m in zip(ticks_of(commands), commands, strict=True)}
    done = {t: list(m.velocity) for t, m in zip(ticks_of(applied), applied, strict=True)}
    for tick in range(TURN, 100, TURN):
        assert done[tick + 1] == done[tick + 2] == said[tick], tick
    assert any(any(velocity) for velocity in said.values())


def test_without_an_operator_the_machine_waits_and_with_one_goes_on(ros: Ros) -> None:
    scene = Scene(ros)
    scene.machine(command_wait_period=TURN)
    ros.spin_until(lambda: scene.tick == 0)
    ros.spin_for(0.4)
    assert scene.tick == 0
    operator = ros.add(DigOperatorNode)
    scene.until_tick(20)
    ros.remove(operator)
    ros.spin_for(0.3)
    stood = scene.tick
    ros.spin_for(0.3)
    assert scene.tick == stood


def test_it_tells_its_phases(ros: Ros) -> None:
    phases = ros.collect("/excavator/operator/phase", String)
    _, operator = working(ros)
    ros.spin_until(lambda: len(phases) >= 3)
    told = [json.loads(message.data) for message in phases]
    assert [each["phase"] for each in told[:3]] == ["approach", "brace", "reach"]
    assert {each["cycle"] for each in told} == {1}
    times = [each["time"] for each in told]
    assert times == sorted(times)
    assert not operator.finished


def test_it_ends_with_1_when_it_gave_up_and_leaves_the_levers(ros: Ros) -> None:
    phases = ros.collect("/excavator/operator/phase", String)
    _, operator = working(ros, **{"task.timeout": 1.0})
    ros.spin_until(lambda: operator.finished)
    assert operator.exit_code == 1
    ros.spin_until(lambda: json.loads(phases[-1].data)["phase"] == "done")
    assert "1.0 s of simulated time" in json.loads(phases[-1].data)["abort_reason"]
    operator.stop()


def test_a_reset_begins_the_shift_anew(ros: Ros) -> None:
    commands = ros.collect("/excavator/joint_commands", JointState)
    scene, operator = working(ros)
    ros.spin_until(lambda: operator.task.phase == "reach")
    first = operator.task
    scene.trigger("/sim/reset")
    ros.spin_until(lambda: operator.task is not first)
    del commands[:]
    scene.until_tick(10)
    assert operator.task.phase == "approach"
    ros.spin_until(lambda: operator.task.phase == "reach")
    assert scene.joined == (1,)


def test_after_a_pause_it_goes_on(ros: Ros) -> None:
    scene, operator = working(ros)
    scene.until_tick(10)
    scene.pause()
    ros.spin_for(0.3)
    scene.pause(False)
    ros.spin_until(lambda: operator.task.phase == "reach")


def test_it_sees_in_real_time_too(ros: Ros) -> None:
    applied = ros.collect("/excavator/applied_commands", JointState)
    scene = Scene(ros, sync="realtime", machine_timeout=20.0)
    scene.machine()
    ros.add(DigOperatorNode)
    ros.spin_until(lambda: any(any(message.velocity) for message in applied))


NAMES = ["swing", "boom", "arm", "bucket"]
BROKEN = [
    ("joint_states", JointState(name=["swing"], position=[0.0, 1.0])),
    ("joint_states", JointState(name=["swing"], position=[0.0])),
    ("joint_states", JointState(name=NAMES, position=[0.0, math.nan, 0.0, 0.0])),
    ("odom", Odometry()),
    ("payload", Float64MultiArray(data=[1.0])),
    ("/soil/ledger", Int64MultiArray(data=[1])),
    ("/sim/config", String(data="{}")),
]


def test_broken_messages_are_refused_and_the_work_goes_on(ros: Ros) -> None:
    scene, operator = working(ros)
    scene.until_tick(4)
    counts: dict[str, int] = {}
    for topic, message in BROKEN:
        name = topic if topic.startswith("/") else f"/excavator/{topic}"
        profile = qos.TRANSIENT_LOCAL if topic == "/sim/config" else qos.ROWS
        publisher = ros.publisher(name, type(message), profile, subscriptions=1)
        publisher.publish(message)
        key, counts[topic] = f"refused {topic}", counts.get(topic, 0) + 1
        wanted = str(counts[topic])
        ros.spin_until(
            lambda key=key, wanted=wanted: operator.diagnostics.report().values.get(key) == wanted
        )
        ros.helper.destroy_publisher(publisher)
    stood = scene.tick
    ros.spin_until(lambda: scene.tick >= stood + 20)


@pytest.mark.slow
def test_it_digs_a_bucketful_and_reports_it(ros: Ros) -> None:
    cycles = ros.collect("/excavator/operator/cycles", String)
    scene, operator = working(ros, **{"task.cycles": 1})
    ros.spin_until(lambda: operator.finished, timeout=250.0)
    assert operator.exit_code == 0
    ros.spin_until(lambda: cycles)
    report = json.loads(cycles[0].data)
    assert report["number"] == 1
    assert report["moved_volume"] > 0.3
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
    assert scene.trigger("/soil/verify").success

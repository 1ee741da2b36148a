"""Machine node: what it waits for is in its diagnostics and its log."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import TICK, Scene, joint_command

from machine_sim.node.machine_node import MachineNode
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.wait_log import CHECK_PERIOD
from msg_bridge.testing.ros_context import Ros


def until_waiting(scene: Scene, node: MachineNode, what: str) -> None:
    """Spin until a node reports that it waits for something."""
    ros = scene.ros
    ros.spin_until(lambda: what in scene.shown(node).get("waiting_for", ""), what=what)
    report = scene.shown(node)
    assert report["level"] == "1"
    assert f"waiting for {report['waiting_for']}" in report["message"]


def test_machine_without_a_soil_waits_for_its_configuration(ros: Ros) -> None:
    reports = ros.collect("/diagnostics", DiagnosticArray)
    ros.add(MachineNode)
    ros.spin_until(lambda: reports and "waiting for /sim/config" in reports[-1].status[0].message)


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_machine_reports_a_soil_that_is_silent_until_it_is_back(
    ros: Ros, sync: str, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, sync=sync, machine_timeout=20.0)
    machine = scene.machine()
    scene.until_tick(5)
    ros.executor.remove_node(scene.soil)  # its process is suspended
    until_waiting(scene, machine, "messages of the soil on /soil/tick")
    ros.executor.add_node(scene.soil)
    scene.until_shown(machine, "waiting_for", "nothing")
    output = capfd.readouterr().err
    assert output.count("waiting for messages of the soil on /soil/tick") == 1
    assert output.count("for messages of the soil on /soil/tick is over") == 1


def test_machine_that_ends_while_it_waits_does_not_log_that_the_wait_is_over(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, machine_timeout=20.0)
    machine = scene.machine()
    scene.until_tick(5)
    ros.executor.remove_node(scene.soil)  # its process has ended
    until_waiting(scene, machine, "messages of the soil on /soil/tick")
    machine.stop()
    assert machine.stopping
    ros.spin_for(3 * CHECK_PERIOD)
    output = capfd.readouterr().err
    assert output.count("waiting for messages of the soil on /soil/tick") == 1
    assert "is over" not in output


def test_pause_is_no_wait(ros: Ros) -> None:
    scene = Scene(ros)
    machine = scene.machine()
    scene.until_tick(5)
    scene.pause()
    ros.spin_for(1.6)
    for node in (machine, scene.soil):
        node.diagnostics.publish()
        scene.until_shown(node, "waiting_for", "nothing")
    ros.executor.remove_node(scene.soil)
    until_waiting(scene, machine, "messages of the soil")


def test_machine_reports_the_command_it_waits_for(ros: Ros) -> None:
    scene = Scene(ros)
    machine = scene.machine(command_wait_period=2)
    until_waiting(scene, machine, "a command for excavator with a stamp of 0 s or later")
    ros.spin_until(lambda: "tick of /excavator" in scene.shown(scene.soil)["waiting_for"])


def test_machine_that_receives_commands_of_another_clock_reports_the_last_stamp(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros)
    machine = scene.machine(command_wait_period=2)
    commands = ros.publisher("/excavator/joint_commands", JointState)
    wall_ticks = itertools.count(10**6)
    stamps: list[float] = []

    def send() -> None:
        """Send a command with a new stamp, more often than waits are checked."""
        stamps.append(next(wall_ticks) * TICK)
        commands.publish(joint_command(round(stamps[-1] / TICK), np.zeros(len(COMMAND_NAMES))))

    timer = ros.add(SimNode, "controller").create_timer(0.05, send)
    until_waiting(scene, machine, "a stamp of 0 s or later; command_wait_period is set")
    until_waiting(scene, machine, "the last command for excavator had the stamp 1000")
    num_sent = len(stamps)
    ros.spin_until(lambda: len(stamps) >= num_sent + 10)
    timer.cancel()
    until_waiting(scene, machine, f"had the stamp {stamps[-1]:.6f} s: stamp each with")
    output = capfd.readouterr().err
    assert output.count("waiting for a command for excavator") == 1
    assert "is over" not in output


def test_machine_and_soil_report_a_machine_that_has_not_joined(ros: Ros) -> None:
    scene = Scene(ros, expected_machines=[1, 2])
    machine = scene.machine()
    until_waiting(scene, machine, "the answer to the request to join")
    # The soil may have published its first report before the machine asked to join.
    ros.spin_until(
        lambda: scene.shown(scene.soil)["waiting_for"].startswith(
            "machines with machine_id 2 to join"
        )
    )


def test_restarted_machine_reports_where_it_starts(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros)
    first = scene.machine(x=3.0)
    scene.until_tick(5)
    start = "no saved state: excavator at x {} m, y 0 m, yaw 0 deg, with empty tools"
    scene.until_shown(first, "session_start", "tick 0, " + start.format(3))
    ros.remove(first)  # killed
    second = scene.machine(x=-4.0)
    ros.spin_until(lambda: start.format(-4) in scene.shown(second).get("session_start", ""))
    (line,) = (each for each in capfd.readouterr().err.splitlines() if "saved state" in each)
    assert "[WARN]" in line
    assert "an earlier session of machine_id 1 held is booked as absent" in line

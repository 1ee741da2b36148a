"""Machine node: parameters, signals, leaving, reset."""

from __future__ import annotations

import signal
import sys
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from support.node_scenes import SITE, Scene
from support.stepped_machine import twist

from dig_operator.node import DigOperatorNode
from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.config_files import ConfigError
from msg_bridge.contract.errors import ParameterError
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros


@pytest.mark.parametrize("node_class", [MachineNode, DigOperatorNode])
def test_each_parameter_has_a_description_and_a_range(ros: Ros, node_class: Any) -> None:
    node: Node = ros.add(node_class)
    names = [n for n in node.list_parameters([], 0).names if n != "use_sim_time"]
    names = [n for n in names if not n.startswith(("qos_overrides", "start_type_description"))]
    assert len(names) > 5
    for descriptor in node.describe_parameters(names):
        assert len(descriptor.description) > 4, descriptor.name
        value = node.get_parameter(descriptor.name).value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            assert [*descriptor.floating_point_range, *descriptor.integer_range], descriptor.name


def test_invalid_parameters_are_rejected(ros: Ros) -> None:
    scene = Scene(ros)
    with pytest.raises(ParameterError, match=r"machine_it.*machine_id"):
        scene.machine(machine_it=2)
    with pytest.raises(ParameterError, match=r"steps_per_tick.*tick_period of the soil"):
        scene.machine(**{"stepping.steps_per_tick": 4})
    with pytest.raises(ConfigError, match="nothing"):
        scene.machine(machine="nothing.yaml")


def test_tick_period_that_is_no_multiple_of_the_step_ends_the_node(ros: Ros) -> None:
    scene = Scene(ros, tick_period=0.012)
    scene.machine()
    with pytest.raises(ParameterError, match="physics_step"):
        scene.until_tick(0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_machine_operator_and_soil_cleanly(
    ros: Ros, ros_process: StartProcess, number: int
) -> None:
    python = sys.executable
    soil = ros_process(
        [python, "-m", "soil_sim.node.soil_node"], parameters={**SITE, "sync": "lockstep"}
    )
    machine = ros_process([python, "-m", "machine_sim.node.machine_node"])
    operator = ros_process([python, "-m", "dig_operator.node"])
    commands = ros.collect("/excavator/joint_commands", JointState)
    reports = ros.collect("/diagnostics", DiagnosticArray, qos.STATE)
    ros.spin_until(lambda: commands)
    assert operator.stop(number) == 0
    assert machine.stop(number) == 0

    def machines() -> str:
        for array in reversed(reports):
            for status in array.status:
                if status.name.startswith("soil_sim"):
                    return {v.key: v.value for v in status.values}.get("machines", "")
        return ""

    # No machine is left that could be late: one that left is not silent.
    ros.spin_until(lambda: machines() == "none")
    assert soil.stop(number) == 0
    assert "silent" not in soil.output
    for event in ("joined", "left"):
        assert soil.output.count(f"/excavator (machine_id 1) {event} in tick") == 1
    assert machine.output.count("joined run") == 1
    assert "the task of the excavator starts" in operator.output


def test_leaving_machine_transfers_its_account_and_is_not_dropped(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, machine_timeout=0.2)
    machine = scene.machine()
    scene.until_tick(5)
    scene.leave(machine)
    assert scene.joined == ()
    ros.spin_for(0.6)
    assert "silent" not in capfd.readouterr().err
    assert scene.ledgers[-1].absent == 0


def test_reset_restores_the_initial_pose_and_clears_commands(ros: Ros) -> None:
    scene = Scene(ros)
    machine = scene.machine(**{"commands.command_timeout": 60.0})
    scene.until_tick(1)
    publisher = ros.publisher("/excavator/cmd_vel", TwistStamped, subscriptions=1)
    publisher.publish(twist(1.0, 0.0))
    first = machine.run
    assert first is not None
    ros.spin_until(lambda: first.sim.machine.base_pose[0][0] > 0.3)
    assert scene.trigger("/sim/reset").success
    ros.spin_until(lambda: machine.run is not first)
    scene.until_tick(30)
    run = machine.run
    assert run is not None
    assert run.facts.run_id == scene.soil.run.endpoint.exchange.run_id
    assert np.abs(run.sim.machine.base_pose[0][:2]).max() < 0.05
    assert scene.joined == (1,)

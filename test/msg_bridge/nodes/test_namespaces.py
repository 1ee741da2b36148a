"""Topic names, and two simulations side by side in one ROS domain."""

from __future__ import annotations

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Int64MultiArray
from support.node_scenes import SITE, TICK

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract import topics
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode


@pytest.mark.parametrize(
    ("namespace", "parent"), [("/", "/"), ("/excavator", "/"), ("/a/excavator", "/a")]
)
def test_parent_namespace_is_one_level_up(namespace: str, parent: str) -> None:
    assert topics.parent_namespace(namespace) == parent


@pytest.mark.parametrize(
    ("topic", "simulation", "machine"),
    [
        ("/excavator/soil_tick", "/", "/excavator"),
        ("/a/excavator/soil_tick", "/a", "/a/excavator"),
        ("/a/excavator/soil_tick", "/", None),
        ("/a/excavator/soil_tick", "/b", None),
        ("/soil_tick", "/", None),
        ("/excavator/odom", "/", None),
    ],
)
def test_machine_nodes_belong_to_the_namespace_above_theirs(
    topic: str, simulation: str, machine: str | None
) -> None:
    assert topics.machine_node_namespace(topic, simulation) == machine


def test_two_simulations_run_in_two_namespaces_of_one_domain(ros: Ros) -> None:
    ledgers, states, machines = {}, {}, {}
    for name in ("a", "b"):
        ledgers[name] = ros.collect(f"/{name}/soil/ledger", Int64MultiArray)
        states[name] = ros.collect(f"/{name}/excavator/joint_states", JointState)
        given = {"sync": "lockstep", "tick_period": TICK, **SITE}
        ros.add(SoilNode, namespace=f"/{name}", parameters=given)
        # The machine ids are equal: the simulations must be independent.
        machines[name] = ros.add(
            MachineNode,
            namespace=f"/{name}/excavator",
            parameters={"commands.command_timeout": 10.0, "state_rate": 1.0 / TICK},
        )
    swing = ros.publisher("/a/excavator/joint_commands", JointState, subscriptions=1)
    ros.spin_until(lambda: all(states.values()), what="the states of both machines")
    swing.publish(JointState(name=["swing"], velocity=[0.5]))

    def angle(name: str) -> float:
        state = states[name][-1]
        return float(state.position[list(state.name).index("swing")])

    ros.spin_until(lambda: angle("a") > 0.05, what="the first machine to swing")
    assert angle("b") == pytest.approx(0.0, abs=1e-4)
    for name, machine in machines.items():
        found = [from_multi_array(message) for message in ledgers[name]]
        assert {ledger.imbalance for ledger in found} == {0}
        assert machine.run is not None
    # All absolute topics are those of ROS.
    names = {name for name, _ in ros.helper.get_topic_names_and_types()}
    outside = {name for name in names if not name.startswith(("/a/", "/b/"))}
    assert outside <= {"/parameter_events", "/rosout"}

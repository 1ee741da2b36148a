"""Layouts for other people's viewers name topics, types and array positions that exist."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from machine_sim.machine import load_machine_spec
from msg_bridge.codec.array_labels import known_labels
from msg_bridge.codec.machine_state import PayloadState, to_cylinder_array, to_payload_array
from msg_bridge.config_files import find_config
from msg_bridge.contract.cylinder_state import CylinderState
from msg_bridge.contract.interface import INTERFACE, Endpoint, EndpointKind, Scope
from msg_bridge.contract.ledger import Ledger

EXCAVATOR = "/excavator/"

RVIZ_TYPES = {
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "RobotModel": "std_msgs/msg/String",
    "Odometry": "nav_msgs/msg/Odometry",
}


def endpoint(topic: str) -> Endpoint:
    """Return the entry of a topic of the simulation in / with its machine in /excavator."""
    in_simulation = not topic.startswith(EXCAVATOR)
    name = topic.removeprefix("/" if in_simulation else EXCAVATOR)
    (found,) = (
        each
        for each in INTERFACE
        if each.kind is EndpointKind.TOPIC
        and each.name == name
        and (each.scope is Scope.SIMULATION) == in_simulation
    )
    return found


def layout() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(find_config("foxglove_layout.json").read_text())
    return content


def panels(kind: str) -> dict[str, dict[str, Any]]:
    return {
        name.split("!")[1]: config
        for name, config in layout()["configById"].items()
        if name.startswith(f"{kind}!")
    }


def message_paths() -> list[str]:
    """Return the message paths of plots, state transitions and indicators."""
    series = [*panels("Plot").values(), *panels("StateTransitions").values()]
    return [
        *(path["value"] for panel in series for path in panel["paths"]),
        *(panel["path"] for panel in panels("Indicator").values()),
    ]


def leaves(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from (*leaves(node["first"]), *leaves(node["second"]))


def test_foxglove_layout_shows_every_panel_once():
    assert sorted(leaves(layout()["layout"])) == sorted(layout()["configById"])


def test_topics_of_the_foxglove_layout_exist_with_types_that_panels_show():
    (site,) = panels("3D").values()
    types = {topic: endpoint(topic).type for topic in site["topics"]}
    assert types == {
        "/terrain/map": "sensor_msgs/msg/PointCloud2",
        "/excavator/particles": "sensor_msgs/msg/PointCloud2",
        "/excavator/markers": "visualization_msgs/msg/MarkerArray",
    }
    urdf = site["layers"]["excavator"]
    assert endpoint(urdf["topic"]).name == "robot_description"
    assert endpoint(panels("Teleop")["excavator"]["topic"]).name == "cmd_vel"
    assert endpoint(panels("DiagnosticSummary")["nodes"]["topicToRender"]).name == "diagnostics"


def test_message_paths_of_the_foxglove_layout_begin_with_topics_that_exist():
    scripts = layout()["userNodes"].values()
    outputs = {re.search(r'output = "([^"]+)"', each["sourceCode"])[1] for each in scripts}
    for path in message_paths():
        topic = path.partition(".")[0]
        if topic.startswith("/studio_script/"):
            assert topic in outputs
        else:
            assert endpoint(topic).name
    for each in scripts:
        (topic,) = re.search(r'inputs = \["([^"]+)"\]', each["sourceCode"]).groups()
        assert f'Input<"{topic}">' in each["sourceCode"]
        assert endpoint(topic).type in ("std_msgs/msg/String", "std_msgs/msg/Int64MultiArray")


def test_plotted_positions_of_arrays_have_the_meaning_of_their_legend():
    spec = load_machine_spec(find_config("machines/excavator.yaml"))
    cylinders = to_cylinder_array({name: CylinderState(*range(5)) for name in spec.cylinders}, 0.0)
    payload = to_payload_array(PayloadState(*range(len(PayloadState._fields))))
    labels = {
        "/excavator/cylinders": cylinders.layout.dim[0].label.split(","),
        "/excavator/payload": payload.layout.dim[0].label.split(","),
    }
    meaning = {
        "boom [N]": "boom_force_n",
        "arm [N]": "arm_force_n",
        "bucket [N]": "bucket_force_n",
        "mass [kg]": "mass_kg",
    }
    plotted = {}
    for panel in panels("Plot").values():
        for path in panel["paths"]:
            if found := re.fullmatch(r"(.*)\.data\[(\d+)\]", path["value"]):
                plotted[path["label"]] = labels[found[1]][int(found[2])]
    assert plotted == meaning
    ledger_script = layout()["userNodes"]["ledger"]["sourceCode"]
    assert set(re.findall(r'value\("(\w+)"\)', ledger_script)) <= set(known_labels(Ledger, 0))


def rviz_displays() -> list[dict[str, Any]]:
    content = yaml.safe_load(find_config("earthmoving.rviz").read_text())
    displays: list[dict[str, Any]] = content["Visualization Manager"]["Displays"]
    return displays


@pytest.mark.parametrize("display", rviz_displays(), ids=lambda each: each["Name"])
def test_topics_of_the_rviz_configuration_exist_with_type_and_qos(display):
    topic = display.get("Topic") or display.get("Description Topic")
    kind = display["Class"].split("/")[1]
    if topic is None:
        assert kind in ("TF", "Grid")
        return
    found = endpoint(topic["Value"])
    assert found.type == RVIZ_TYPES[kind]
    is_transient_local = found.qos == "TRANSIENT_LOCAL"
    assert topic["Durability Policy"] == ("Transient Local" if is_transient_local else "Volatile")
    assert topic["Reliability Policy"] == "Reliable"

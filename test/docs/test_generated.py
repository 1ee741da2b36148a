"""The generated documents are current, and the interface table is what the nodes have."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from rclpy.node import Node
from support.node_scenes import SITE

from dig_operator.node import DigOperatorNode
from machine_sim.node.machine_node import MachineNode
from msg_bridge.contract.interface import INTERFACE, Endpoint, EndpointKind, Scope, endpoints_of
from msg_bridge.contract.topics import resolve
from msg_bridge.recorder.recorder_node import RecorderNode
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode
from viewer.cameras.node import CameraNode
from viewer.node import ViewerNode
from viewer.rendering.browser import find_browser
from viewer.rendering.errors import RenderError

ROOT = Path(__file__).parents[2]
OF_ROS = {"/rosout", "/parameter_events"}

PLACEHOLDERS = {
    "<tool>": ("bucket",),
    "<imu>": ("base", "upper"),
    "<bin>": (),
    "<camera>": ("cab",),
}
"""Names that stand for placeholders with the shipped excavator."""


def test_generated_documents_are_current() -> None:
    command = [sys.executable, "docs/generate.py", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def names_of(endpoints: list[Endpoint], *, required: bool) -> dict[str, str]:
    """Return type by absolute name, with the machine in `/excavator`."""
    found = {}
    for each in endpoints:
        if required and each.condition:
            continue
        namespace = "/" if each.scope is Scope.SIMULATION else "/excavator"
        names = [each.name]
        for placeholder, values in PLACEHOLDERS.items():
            if placeholder in each.name:
                names = [each.name.replace(placeholder, value) for value in values]
        found |= {resolve(name, namespace): each.type for name in names}
    return found


def compare(endpoints: list[Endpoint], actual: list[tuple[str, list[str]]]) -> None:
    own = {name: types[0] for name, types in actual if name not in OF_ROS}
    assert names_of(endpoints, required=True).items() <= own.items()
    assert own.items() <= names_of(endpoints, required=False).items()


def skip_without_browser() -> None:
    try:
        find_browser()
    except RenderError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize(
    "executable",
    [
        "soil_sim",
        "machine_sim",
        "dig_operator",
        "viewer",
        "camera",
    ],
)
def test_interface_table_lists_what_a_node_publishes_subscribes_and_serves(
    ros: Ros, executable: str
) -> None:
    soil = ros.add(SoilNode, parameters=SITE)
    machine = ros.add(MachineNode)
    operator = ros.add(DigOperatorNode)
    viewer = ros.add(ViewerNode, parameters={"port": 0})
    nodes: dict[str, Node] = {each.get_name(): each for each in (soil, machine, operator, viewer)}
    if executable == "camera":
        skip_without_browser()
        nodes["camera"] = camera = ros.add(CameraNode)
        ros.spin_until(lambda: camera.has_cameras, what="the camera of the machine")
    node = nodes[executable]
    ros.spin_until(lambda: soil.count_subscribers("/excavator/soil_tick"), what="the machine")
    ros.spin_until(lambda: viewer.scene.machines, what="the machine on the page")
    where = (node.get_name(), node.get_namespace())
    subscribed, published, services = endpoints_of(executable)
    compare(published, node.get_publisher_names_and_types_by_node(*where))
    compare(subscribed, node.get_subscriber_names_and_types_by_node(*where))
    own = f"{node.get_fully_qualified_name()}/"  # parameter services
    compare(
        services,
        [
            each
            for each in node.get_service_names_and_types_by_node(*where)
            if not each[0].startswith(own)
        ],
    )


def test_interface_table_lists_what_the_recorder_publishes(ros: Ros, tmp_path: Path) -> None:
    parameters = {"path": str(tmp_path / "bag"), "progress": False}
    node = ros.add(RecorderNode, parameters=parameters)
    where = (node.get_name(), node.get_namespace())
    compare(
        endpoints_of("exchange_recorder")[1], node.get_publisher_names_and_types_by_node(*where)
    )
    node.stop()


def test_names_are_unique() -> None:
    names = [(each.kind, each.full_name) for each in INTERFACE]
    assert len(set(names)) == len(names)
    assert all(each.qos for each in INTERFACE if each.kind is EndpointKind.TOPIC)

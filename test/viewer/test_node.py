"""A simulation on the page: what clients of the stream get from running nodes, and can do."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState, Joy, PointCloud2
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger
from support.node_scenes import SITE, Scene
from support.stream_client import StreamClient

from machine_sim.machine import load_machine_spec
from machine_sim.machine.description import description_text
from machine_sim.node.machine_node import MachineNode
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.qos import TRANSIENT_LOCAL
from msg_bridge.codec.terrain import cells_of_terrain_cloud, keyframe_of_cells
from msg_bridge.config_files import find_config
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode
from viewer.node import ViewerNode

MACHINE = "/excavator"


class Watched:
    """A simulation, its viewer, and one client."""

    def __init__(self, ros: Ros, **parameters: object) -> None:
        self.ros, self.last_sent = ros, 0.0
        self.scene = Scene(ros, sync="realtime")
        self.machine = self.scene.machine()
        self.viewer = ros.add(ViewerNode, parameters={"port": 0, **parameters})
        self.client = StreamClient(self.viewer.server.port)
        self.client.__enter__()
        ros.spin_until(lambda: self.client.frames and self.client.frames[-1]["machines"])

    def press(self, *held: str) -> None:
        self.client.send(type="drive", machine=MACHINE, held=list(held), deflections={})

    def hold(self, *held: str) -> None:
        """Send held keys again, as a page does every 50 ms."""
        if time.monotonic() - self.last_sent > 0.05:
            self.last_sent = time.monotonic()
            self.press(*held)

    def take_control(self) -> None:
        self.client.send(type="take_control", machine=MACHINE)
        self.ros.spin_until(lambda: MACHINE in self.client.last("control")["drivers"])


@pytest.fixture
def watched(ros: Ros) -> Iterator[Watched]:
    made = Watched(ros)
    yield made
    made.client.close()


def test_page_shows_terrain_and_machines_of_a_simulation(watched: Watched, ros: Ros) -> None:
    client = watched.client
    ros.spin_until(lambda: client.frames[-1]["tick"] > 10)
    site, (state,) = client.last("site"), client.frames[-1]["machines"]
    assert (site["rows"], site["cols"], site["cell"]) == (65, 65, 0.4)
    ros.spin_until(lambda: client.num_tiles == 25)
    model = client.last("machine")["model"]
    assert len(np.frombuffer(state["positions"], "<f4")) == len(model["joints"])
    ros.spin_until(lambda: client.last("machine")["levers"].get("boom") == "right_y")


def test_reset_shows_the_new_run(watched: Watched, ros: Ros) -> None:
    client = watched.client
    ros.spin_until(lambda: client.frames[-1]["tick"] > 20)
    before = client.last("site")["run_id"]
    client.send(type="simulation", action="reset")
    ros.spin_until(lambda: client.last("site")["run_id"] == before + 1)
    ros.spin_until(lambda: client.frames[-1]["run_id"] == before + 1)
    assert client.frames[-1]["tick"] < 20
    ros.spin_until(lambda: client.num_tiles == 25)


def test_machine_moves_while_a_key_is_held_and_digs_what_is_shown(
    watched: Watched, ros: Ros
) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, TRANSIENT_LOCAL)
    states = ros.collect(f"{MACHINE}/joint_states", JointState)
    client = watched.client
    watched.take_control()

    def velocity() -> float:
        return float(states[-1].velocity[states[-1].name.index("boom")])

    def dig() -> bool:
        watched.hold("i")
        return client.frames[-1]["ledger"].get("particles", 0) > 0

    ros.spin_until(dig, timeout=60.0)
    # Without a message of the driver for 0.3 s, the machine stands still.
    ros.spin_until(lambda: abs(velocity()) < 0.01)
    client.send(type="simulation", action="pause")
    ros.spin_until(lambda: client.frames[-1]["paused"])

    def is_equal() -> bool:
        shown = client.heights()
        expected = keyframe_of_cells(cells_of_terrain_cloud(maps[-1]), cell=0.4).elevation
        return bool(np.array_equal(shown, expected.astype(np.float32)))

    ros.spin_until(lambda: client.num_tiles == 25 and is_equal())


def test_lever_that_is_pulled_at_once_moves_the_machine(watched: Watched, ros: Ros) -> None:
    states = ros.collect(f"{MACHINE}/joint_states", JointState)
    watched.take_control()

    def swings() -> bool:
        watched.client.send(type="drive", machine=MACHINE, held=[], deflections={"left_x": 1.0})
        swing = states[-1].name.index("swing") if states else 0
        return bool(states) and abs(states[-1].velocity[swing]) > 0.1

    ros.spin_until(swings)


def test_levers_are_released_when_the_page_is_closed(watched: Watched, ros: Ros) -> None:
    joys = ros.collect(f"{MACHINE}/joy", Joy)
    watched.take_control()
    watched.press("i")
    ros.spin_until(lambda: any(any(joy.axes) for joy in joys))
    watched.client.close()
    ros.spin_until(lambda: not any(joys[-1].axes))


def test_emergency_stop_is_published_and_shown(watched: Watched, ros: Ros) -> None:
    stops = ros.collect(f"{MACHINE}/emergency_stop", Bool, TRANSIENT_LOCAL)

    def is_stopped() -> bool | None:
        return watched.client.frames[-1]["machines"][0]["gauges"]["stopped"]

    ros.spin_until(lambda: is_stopped() is False)  # as the machine reports it
    watched.client.send(type="emergency_stop", machine=MACHINE, pressed=True)
    ros.spin_until(lambda: stops and stops[-1].data)
    ros.spin_until(is_stopped)
    joys = ros.collect(f"{MACHINE}/joy", Joy)
    watched.take_control()
    watched.press("i")
    watched.client.send(type="emergency_stop", machine=MACHINE, pressed=False)
    ros.spin_until(lambda: not stops[-1].data and not is_stopped())
    watched.press("i")  # held through the stop
    watched.press()
    ros.spin_until(lambda: joys)
    assert not any(any(joy.axes) for joy in joys)
    watched.press("i")
    ros.spin_until(lambda: any(any(joy.axes) for joy in joys))


def test_stop_that_the_machine_does_not_report_is_shown_as_requested(
    watched: Watched, ros: Ros
) -> None:
    description = description_text(load_machine_spec(find_config("machines/dumper.yaml")))
    silent = ros.publisher("/silent/robot_description", String, TRANSIENT_LOCAL)
    silent.publish(String(data=description))
    stops = ros.collect("/silent/emergency_stop", Bool, TRANSIENT_LOCAL)

    def gauges() -> dict[str, object]:
        states = {each["id"]: each["gauges"] for each in watched.client.frames[-1]["machines"]}
        return states.get("/silent", {})

    ros.spin_until(gauges)
    watched.client.send(type="emergency_stop", machine="/silent", pressed=True)
    ros.spin_until(lambda: stops and gauges()["stop_requested"])
    assert gauges()["stopped"] is None


def test_machine_that_has_gone_is_removed_and_shown_again(watched: Watched, ros: Ros) -> None:
    watched.scene.leave(watched.machine)
    ros.spin_until(lambda: watched.client.messages["machine_gone"])
    ros.spin_until(lambda: not watched.client.frames[-1]["machines"])
    count = len(watched.client.messages["machine"])
    watched.scene.machine()
    ros.spin_until(lambda: len(watched.client.messages["machine"]) > count)
    ros.spin_until(lambda: watched.client.frames[-1]["machines"])


def test_viewers_of_two_simulations_show_each_its_own(ros: Ros) -> None:
    for namespace, points in (("/", 33), ("/b", 65)):
        machine = f"{namespace.rstrip('/')}/digger"
        parameters = {**SITE, "site.num_points": points, "sync": "realtime"}
        ros.add(SoilNode, namespace=namespace, parameters=parameters)
        ros.add(MachineNode, namespace=machine)
    viewers = [
        ros.add(ViewerNode, namespace=namespace, parameters={"port": 0})
        for namespace in ("/", "/b")
    ]
    ros.spin_until(lambda: all(viewer.scene.terrain.tiles for viewer in viewers))
    ros.spin_until(lambda: all(viewer.scene.machines for viewer in viewers))
    assert [list(viewer.scene.machines) for viewer in viewers] == [["/digger"], ["/b/digger"]]
    assert [viewer.scene.terrain.tiles.grid.rows for viewer in viewers] == [33, 65]


def test_page_records_a_bag_that_can_be_read(ros: Ros, tmp_path: Path) -> None:
    folder = tmp_path / "bags"
    watched = Watched(ros, allow_recording=True, bag_folder=str(folder))
    client = watched.client
    client.send(type="record", on=True)
    ros.spin_until(lambda: client.last("recording")["on"])
    ros.spin_until(lambda: client.last("recording")["bytes"] > 10_000, timeout=60.0)
    client.send(type="record", on=False)
    ros.spin_until(lambda: not client.last("recording")["on"])
    assert client.last("recording")["failure"] == ""
    path = Path(client.last("recording")["path"])
    assert path.parent == folder
    assert "/soil/ledger" in BagReader(path).topics
    client.send(type="list_bags")
    ros.spin_until(lambda: client.last("bags")["names"] == [path.name])
    client.close()


def test_server_is_part_of_the_diagnostics(watched: Watched, ros: Ros) -> None:
    watched.client.send(type="take_control", machine="/missing")
    ros.spin_until(lambda: "no_machine" in watched.client.errors)
    watched.viewer.diagnostics.publish()
    values = watched.viewer.diagnostics.report().values
    assert values["clients"] == "1"
    assert values["rejected no_machine"] == "1"
    assert ros.call(Trigger, "/soil/verify", Trigger.Request()).success

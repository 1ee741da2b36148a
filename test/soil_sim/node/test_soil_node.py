"""Soil node: clock, parameters, startup, diagnostics of lost soil."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from support.node_scenes import TICK, Scene
from support.soil_node_scenes import NO_MACHINES, layered_site_parameters
from support.terrain_errors import raises_terrain_error

from msg_bridge.codec import qos
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.contract.errors import ParameterError
from msg_bridge.testing.ros_context import Ros
from soil_sim.errors import SoilError, TerrainErrorCode
from soil_sim.node import soil_node
from soil_sim.node.imbalance_report import EXIT_IMBALANCE
from soil_sim.node.soil_node import SoilNode
from soil_sim.soil import Soil


def test_clock_without_machines_advances_no_faster_than_wall_time(
    ros: Ros,
) -> None:
    clock = ros.collect("/clock", Clock, qos.STATE)
    start = time.monotonic()
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(40)
    assert time.monotonic() - start > 39 * TICK
    ticks = [tick_from_stamp(message.clock, TICK) for message in clock]
    assert ticks == sorted(set(ticks))
    assert ticks[-1] - ticks[0] >= 20


def test_each_parameter_has_a_description_and_a_range(ros: Ros) -> None:
    node: Node = Scene(ros).soil
    names = [n for n in node.list_parameters([], 0).names if n != "use_sim_time"]
    names = [n for n in names if not n.startswith(("qos_overrides", "start_type_description"))]
    assert {"tick_period", "sync", "site.terrain", "soil.swell"} <= set(names)
    for descriptor in node.describe_parameters(names):
        assert len(descriptor.description) > 4, descriptor.name
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        value = node.get_parameter(descriptor.name).value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            assert ranges, descriptor.name
            assert ranges[0].from_value <= value <= ranges[0].to_value


def test_lost_soil_is_an_error_until_the_run_ends_and_in_the_exit_code(
    ros: Ros, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(1)
    assert scene.soil.exit_code == 0
    start = scene.ledgers[0].start
    monkeypatch.setattr(Soil, "total_mm3", property(lambda soil: soil.columns.total_mm3 - 3))
    scene.more_ticks(1)
    scene.until_shown(scene.soil, "level", 2)
    assert scene.shown(scene.soil)["message"].startswith("imbalance of -3 mm3 at tick")
    assert not scene.trigger("/soil/verify").success
    monkeypatch.undo()  # the soil is found again, but the run is not valid
    scene.more_ticks(5)
    scene.until_shown(scene.soil, "imbalance_mm3", 0)
    assert "imbalance of 0 mm3 at tick" in scene.shown(scene.soil)["message"]
    assert scene.shown(scene.soil)["level"] == "2"
    errors = [line for line in capfd.readouterr().err.splitlines() if "[ERROR]" in line]
    assert len(errors) == 1
    assert f"terrain {start - 3}, in_flight 0, pending 0, particles 0, absent 0" in errors[0]
    scene.trigger("/sim/reset")
    scene.until_shown(scene.soil, "level", 0)
    assert scene.soil.exit_code == EXIT_IMBALANCE


@pytest.mark.parametrize("is_expected", [True, False])
def test_machine_joins_a_soil_that_was_restarted_within_a_second(
    ros: Ros, monkeypatch: pytest.MonkeyPatch, *, is_expected: bool
) -> None:
    """A soil that does not wait for it has begun its first ticks when it receives its messages."""
    scene = Scene(ros) if is_expected else Scene(ros, **NO_MACHINES, admit_other_machines=True)
    scene.machine()
    ros.spin_until(lambda: scene.joined == (1,))
    scene.more_ticks(5)
    before = scene.ledgers[-1].run_id
    ros.remove(scene.soil)
    monkeypatch.setattr(soil_node.time, "time", lambda: before)
    scene.soil = ros.add(SoilNode, parameters=scene.given)
    ros.spin_until(lambda: scene.joined == (1,))
    assert scene.soil.run.endpoint.exchange.run_id == before + 1
    scene.more_ticks(5)


def test_first_tick_waits_for_required_subscribers_of_every_topic(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES, required_subscribers=["recorder"])
    ros.spin_for(0.4)
    assert scene.tick == -1
    recorder = ros.node("recorder")
    topics = {p.topic_name: p.msg_type for p in scene.soil.publishers}
    last = topics.pop("/soil/forces")
    for topic, message_type in topics.items():
        recorder.create_subscription(message_type, topic, lambda message: None, 10)
    ros.spin_for(0.4)
    assert scene.tick == -1
    recorder.create_subscription(last, "/soil/forces", lambda message: None, 10)
    scene.until_tick(1)


def test_invalid_site_parameters_are_rejected(ros: Ros) -> None:
    with raises_terrain_error(TerrainErrorCode.NO_FILE):
        Scene(ros, **{"site.terrain": "nowhere.asc"})
    with raises_terrain_error(TerrainErrorCode.NO_FILE, match=r"^site\.design: nowhere\.asc"):
        Scene(ros, **{"site.design": "nowhere.asc"})
    with pytest.raises(ParameterError, match="sync"):
        Scene(ros, sync="sometimes")


def test_map_with_unknown_soil_ids_is_rejected(ros: Ros, tmp_path: Path) -> None:
    options = {**layered_site_parameters(tmp_path), "soil.additional_soils": []}
    with pytest.raises(SoilError, match=r"soil\.additional_soils names 0 kinds"):
        Scene(ros, **options)

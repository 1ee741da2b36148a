"""The soil node: time, publications, services."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from nav_msgs.msg import MapMetaData
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, String
from std_srvs.srv import Trigger
from support.node_scenes import TICK, Scene, dig, machine_file, ready_to_dig

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.codec.cut_fill import from_cut_fill_array
from msg_bridge.codec.run_config import parse_run_facts, soil_kinds
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.testing.ros_context import Ros
from soil_sim.errors import SoilError, TerrainError
from soil_sim.site.design import compare_to_design
from soil_sim.soils.soil_types import load_soil_types
from soil_sim.terrain import (
    HeightMap,
    Layers,
    load_terrain,
    load_terrain_with_layers,
    save_terrain,
)

ALONE = {"sync": "realtime", "expected_machines": []}

PROFILES = {
    "/clock": qos.STATE,
    "/soil/ledger": qos.ROWS,
    "/soil/tick": qos.ROWS,
    "/soil/join_rejections": qos.ROWS,
    "/soil/conversions": qos.ROWS,
    "/soil/forces": qos.ROWS,
    "/soil/state_hash": qos.STATE,
    "/terrain/map_updates": qos.ROWS,
    "/terrain/map": qos.TRANSIENT_LOCAL,
    "/terrain/elevation": qos.TRANSIENT_LOCAL,
    "/terrain/info": qos.TRANSIENT_LOCAL,
    "/sim/config": qos.TRANSIENT_LOCAL,
    "/sim/paused": qos.TRANSIENT_LOCAL,
}


def digging(ros: Ros, folder: Path, **parameters: object) -> Scene:
    """A scene whose machine has soil in its bucket."""
    scene = Scene(ros, **parameters)
    options = {"commands.command_timeout": 60.0, "machine": machine_file(folder, ready_to_dig())}
    machine = scene.machine(**options)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    return scene


def layered_site(folder: Path) -> dict[str, object]:
    """Parameters of level ground, half of it clay, moister from row to row."""
    grid = Grid(65, 65, 0.4)
    ids = np.zeros(grid.shape, dtype=np.uint8)
    ids[:, 30:] = 1
    moisture = np.repeat(np.arange(65, dtype=np.uint8)[:, None], 65, axis=1)
    path = folder / "site.npz"
    save_terrain(path, HeightMap(grid, np.zeros(grid.shape)), layers=Layers(ids, moisture))
    soils = {"soil.soil": "dry sand", "soil.additional_soils": ["dry clay"]}
    return {"site.terrain": str(path), **soils}


def design_file(folder: Path) -> str:
    """A pit of 0.5 m that is designed where the machine digs, and nothing around it."""
    heights = np.full((65, 65), np.nan)
    heights[8:48, 28:37] = -0.5
    np.save(folder / "design.npy", heights)
    return str(folder / "design.npy")


def ticks_of(clock: list[Clock]) -> list[int]:
    return [tick_from_stamp(message.clock, TICK) for message in clock]


# Publications.


def test_in_real_time_the_clock_goes_on_without_machines_and_not_faster_than_the_wall(
    ros: Ros,
) -> None:
    clock = ros.collect("/clock", Clock, qos.STATE)
    began = time.monotonic()
    scene = Scene(ros, **ALONE)
    scene.until_tick(40)
    assert time.monotonic() - began > 39 * TICK
    received = ticks_of(clock)
    assert received == sorted(set(received))
    assert received[-1] - received[0] >= 20


def test_who_comes_late_gets_the_terrain_and_the_configuration(ros: Ros) -> None:
    scene = Scene(ros, **ALONE, **{"soil.swell": 0.25, "site.terrain": "rough"})
    scene.until_tick(3)
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    images = ros.collect("/terrain/elevation", Image, qos.TRANSIENT_LOCAL)
    infos = ros.collect("/terrain/info", MapMetaData, qos.TRANSIENT_LOCAL)
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    paused = ros.collect("/sim/paused", Bool, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: maps and images and infos and configs and paused)
    columns = scene.soil.run.endpoint.soil.columns
    heights = columns.height.astype(np.float32)
    assert heights.std() > 0.01

    terrain = from_terrain_cloud(maps[0])
    assert maps[0].header.frame_id == images[0].header.frame_id == "map"
    assert terrain.keyframe.grid == Grid(65, 65, 0.4)
    assert (terrain.keyframe.elevation == heights).all()
    assert (terrain.volume_mm3 == columns.firm + columns.loose).all()
    image = np.frombuffer(images[0].data, np.float32).reshape(images[0].height, images[0].width)
    assert (image == heights).all()
    assert (infos[0].width, infos[0].height) == (65, 65)
    assert infos[0].resolution == pytest.approx(0.4)
    assert infos[0].origin.position.x == pytest.approx(-13.0)
    facts = parse_run_facts(configs[0].data)
    assert (facts.tick_period, facts.realtime, facts.cell) == (TICK, True, 0.4)
    assert [soil.swell for soil in facts.soils] == [0.25]
    assert facts.run_id == terrain.keyframe.run_id == scene.soil.run.endpoint.exchange.run_id
    content = yaml.safe_load(configs[0].data)
    assert content["site"]["num_points"] == content["grid"]["rows"] == 65
    assert content["soil"]["swell"] == 0.25
    assert not paused[0].data


def test_the_map_shows_what_the_surface_is_and_how_moist(ros: Ros, tmp_path: Path) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = digging(ros, tmp_path, map_rate=20.0, **layered_site(tmp_path))
    scene.more_ticks(10)
    scene.pause()
    soil = scene.soil.run.endpoint.soil
    ros.spin_until(lambda: from_terrain_cloud(maps[-1]).keyframe.revision == soil.revision)
    first, newest = from_terrain_cloud(maps[0]), from_terrain_cloud(maps[-1])
    assert (first.soil[:, :30] == 0).all()
    assert (first.soil[:, 30:] == 1).all()
    assert (first.moisture == np.arange(65)[:, None]).all()
    assert not first.surface_material.any()
    assert np.isnan(first.design_difference).all()
    assert (newest.surface_material == soil.columns.material).all()
    assert newest.surface_material.any()
    assert (newest.soil == soil.columns.top_soil).all()
    assert (newest.moisture == soil.columns.moisture).all()


def test_the_configuration_says_what_the_ids_of_soils_mean(ros: Ros, tmp_path: Path) -> None:
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    Scene(ros, **ALONE, **layered_site(tmp_path))
    ros.spin_until(lambda: configs)
    shipped = load_soil_types()
    kinds = soil_kinds(configs[0].data)
    assert [kind.name for kind in kinds] == ["dry sand", "dry clay"]
    for kind in kinds:
        given = shipped[kind.name]
        assert (kind.colour, kind.swell, kind.density) == (
            given.colour,
            given.swell,
            given.density,
        )
        assert kind.repose_angles[1] == given.repose_angle_damp
    loose = [shipped[kind.name].loose_soil for kind in kinds]
    assert list(parse_run_facts(configs[0].data).soils) == loose


def test_soil_that_was_given_without_a_name_has_none(ros: Ros) -> None:
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    Scene(ros, **ALONE, **{"soil.swell": 0.25, "soil.repose_angle": 40.0})
    ros.spin_until(lambda: configs)
    (kind,) = soil_kinds(configs[0].data)
    assert (kind.name, kind.swell, kind.repose_angles) == ("", 0.25, (40.0, 40.0, 40.0))


# The design.


def test_cut_and_fill_are_told_to_late_comers_and_follow_what_is_dug(
    ros: Ros, tmp_path: Path
) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = digging(ros, tmp_path, map_rate=20.0, **{"site.design": design_file(tmp_path)})
    scene.more_ticks(10)
    scene.pause()
    received = ros.collect("/soil/cut_fill", Float64MultiArray, qos.TRANSIENT_LOCAL)
    run = scene.soil.run
    soil, design = run.endpoint.soil, scene.soil.site.design
    assert design is not None
    ros.spin_until(lambda: from_terrain_cloud(maps[-1]).keyframe.revision == soil.revision)
    expected = compare_to_design(design, soil.columns.height)
    ros.spin_until(lambda: received and from_cut_fill_array(received[-1]).cut == expected.cut)
    state = from_cut_fill_array(received[-1])
    assert state.remaining == expected.remaining
    assert 0.0 < state.time <= run.tick * TICK
    before = from_terrain_cloud(maps[0])
    assert np.nansum(before.design_difference) * 0.16 == pytest.approx(40 * 9 * 0.16 * 0.5)
    assert expected.cut < 40 * 9 * 0.16 * 0.5
    shown = from_terrain_cloud(maps[-1]).design_difference
    assert np.array_equal(shown, expected.difference, equal_nan=True)
    quality = next(p for p in scene.soil.publishers if p.topic_name == "/soil/cut_fill").qos_profile
    assert quality.durability == qos.TRANSIENT_LOCAL.durability


def test_cut_and_fill_are_told_again_only_where_anything_changed(ros: Ros, tmp_path: Path) -> None:
    received = ros.collect("/soil/cut_fill", Float64MultiArray, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **ALONE, map_rate=20.0, **{"site.design": design_file(tmp_path)})
    scene.until_tick(20)
    (state,) = map(from_cut_fill_array, received)
    assert state == (0.0, pytest.approx(28.8), 0.0, pytest.approx(28.8), 0.0)


def test_after_a_reset_all_of_the_design_is_to_be_dug_again(ros: Ros, tmp_path: Path) -> None:
    received = ros.collect("/soil/cut_fill", Float64MultiArray, qos.TRANSIENT_LOCAL)
    options = {**layered_site(tmp_path), "site.design": design_file(tmp_path)}
    scene = digging(ros, tmp_path, map_rate=20.0, **options)
    ros.spin_until(lambda: from_cut_fill_array(received[-1]).cut < 28.7)
    scene.trigger("/sim/reset")
    ros.spin_until(lambda: from_cut_fill_array(received[-1]).cut == pytest.approx(28.8, abs=1e-9))
    columns = scene.soil.run.endpoint.soil.columns
    assert (columns.soil[:, 30:] == 1).all()
    assert (columns.moisture[64] == 64).all()


def test_how_the_surface_leans_is_told_to_who_draws_it(ros: Ros) -> None:
    received = ros.collect("/terrain/surface_tilt", Image, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **ALONE, **{"soil.surface_tilt_noise": 8.0})
    ros.spin_until(lambda: received)
    rows, cols = scene.soil.run.endpoint.soil.grid.shape
    image = received[0]
    assert (image.encoding, image.height, image.width) == ("32FC2", rows, cols)
    slopes = np.frombuffer(image.data, "<f4").reshape(rows, cols, 2)
    assert 0.1 < np.abs(slopes).max() <= math.tan(math.radians(8.0)) + 1e-6
    assert abs(slopes.mean()) < 0.01


def test_each_topic_has_its_quality_of_service(ros: Ros) -> None:
    scene = Scene(ros)
    profiles = {publisher.topic_name: publisher.qos_profile for publisher in scene.soil.publishers}
    for topic, wanted in PROFILES.items():
        found = profiles[topic]
        assert (found.depth, found.reliability, found.durability, found.history) == (
            wanted.depth,
            wanted.reliability,
            wanted.durability,
            wanted.history,
        ), topic
    assert set(profiles) - set(PROFILES) <= {
        "/parameter_events",
        "/rosout",
        "/diagnostics",
        "/terrain/grid_map",
    }


def test_each_parameter_says_what_it_is_and_how_far_it_goes(ros: Ros) -> None:
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


def test_hashes_come_at_their_period_and_maps_only_where_anything_changed(ros: Ros) -> None:
    hashes = ros.collect("/soil/state_hash", String, qos.STATE)
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **ALONE, hash_rate=1.0 / (5 * TICK), map_rate=20.0)
    scene.until_tick(31)
    decoded = [from_state_hash_string(message) for message in hashes]
    ticks = [each.tick for each in decoded]
    assert ticks[-1] >= 30
    assert all(tick % 5 == 0 for tick in ticks)
    assert {each.sha256 for each in decoded} == {scene.soil.run.endpoint.soil.state_hash()}
    assert {each.run_id for each in decoded} == {scene.soil.run.endpoint.exchange.run_id}
    assert [tick_from_stamp(each.stamp, TICK) for each in decoded] == ticks
    assert len(maps) == 1


def test_maps_follow_what_changes(ros: Ros, tmp_path: Path) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = digging(ros, tmp_path, map_rate=20.0)
    scene.more_ticks(10)
    scene.pause()
    soil = scene.soil.run.endpoint.soil
    ros.spin_until(lambda: from_terrain_cloud(maps[-1]).keyframe.revision == soil.revision)
    newest = from_terrain_cloud(maps[-1])
    assert (newest.keyframe.elevation == soil.columns.height.astype(np.float32)).all()
    assert newest.volume_mm3.sum() == soil.total_mm3


def test_soil_that_is_lost_is_said_loudly(ros: Ros) -> None:
    scene = Scene(ros, **ALONE)
    scene.until_tick(1)
    scene.soil.run.endpoint.exchange.accounts._outside -= 3
    scene.more_ticks(1)
    scene.until_shown(scene.soil, "level", 2)
    assert scene.shown(scene.soil)["message"].startswith("imbalance of -3 mm3 at tick")
    assert not scene.trigger("/soil/verify").success


def test_the_first_tick_waits_for_listeners_to_every_topic(ros: Ros) -> None:
    scene = Scene(ros, **ALONE, required_subscribers=["witness"])
    ros.spin_for(0.4)
    assert scene.tick == -1
    witness = ros.node("witness")
    topics = {p.topic_name: p.msg_type for p in scene.soil.publishers}
    last = topics.pop("/soil/forces")
    for topic, of in topics.items():
        witness.create_subscription(of, topic, lambda message: None, 10)
    ros.spin_for(0.4)
    assert scene.tick == -1
    witness.create_subscription(last, "/soil/forces", lambda message: None, 10)
    scene.until_tick(1)


def test_bad_ground_is_refused_with_a_sentence(ros: Ros) -> None:
    with pytest.raises(TerrainError, match=r"nowhere\.asc"):
        Scene(ros, **{"site.terrain": "nowhere.asc"})
    with pytest.raises(TerrainError, match=r"site\.design: nowhere\.asc"):
        Scene(ros, **{"site.design": "nowhere.asc"})
    with pytest.raises(ParameterError, match="sync"):
        Scene(ros, sync="sometimes")


# Services.


def test_paused_no_tick_comes_until_it_goes_on(ros: Ros) -> None:
    paused = ros.collect("/sim/paused", Bool, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **ALONE)
    scene.until_tick(2)
    response = scene.pause()
    stood = scene.tick
    assert response.success
    assert response.message == f"paused at tick {stood}"
    ros.spin_until(lambda: paused and paused[-1].data)
    ros.spin_for(0.15)
    assert scene.tick == stood
    assert scene.pause(False).message.startswith("running")
    ros.spin_until(lambda: not paused[-1].data)
    scene.until_tick(stood + 3)
    assert scene.soil.run.scheduler.num_reschedules == 0


def test_a_step_does_one_tick(ros: Ros) -> None:
    scene = Scene(ros, **ALONE, paused=True)
    ros.spin_until(lambda: scene.tick == 0)
    for tick in (1, 2):
        response = scene.trigger("/sim/step")
        assert response.success
        assert response.message == f"tick {tick} completed"
        assert scene.tick == tick


def test_a_step_is_refused_while_time_goes_on(ros: Ros) -> None:
    scene = Scene(ros, **ALONE)
    scene.until_tick(1)
    response = scene.trigger("/sim/step")
    assert not response.success
    assert "/sim/pause" in response.message


def test_a_step_is_refused_before_the_run_has_begun(ros: Ros) -> None:
    response = Scene(ros, paused=True).trigger("/sim/step")
    assert not response.success
    assert "has not joined" in response.message


def asked(scene: Scene, count: int) -> list[Future]:
    """Steps asked for that the soil has taken on and cannot do yet."""
    client = scene.ros.helper.create_client(Trigger, "/sim/step")
    scene.ros.spin_until(client.service_is_ready)
    steps = [client.call_async(Trigger.Request()) for _ in range(count)]
    scene.ros.spin_until(
        lambda: scene.soil.num_pending_steps + sum(s.done() for s in steps) == count
    )
    return steps


def test_steps_wait_for_a_machine_that_is_late(ros: Ros) -> None:
    scene = Scene(ros, paused=True)
    machine = scene.machine()
    ros.spin_until(lambda: scene.tick == 0)
    ros.executor.remove_node(machine)
    steps = asked(scene, 3)
    assert not steps[2].done()
    ros.executor.add_node(machine)
    ros.spin_until(lambda: all(step.done() for step in steps))
    assert [step.result().message for step in steps] == [f"tick {n} completed" for n in (1, 2, 3)]
    assert scene.tick == 3


def test_a_step_that_a_reset_overtakes_is_answered(ros: Ros) -> None:
    scene = Scene(ros, paused=True)
    machine = scene.machine()
    ros.spin_until(lambda: scene.tick == 0)
    ros.executor.remove_node(machine)
    steps = asked(scene, 3)
    assert scene.trigger("/sim/reset").success
    ros.spin_until(steps[2].done)
    assert not steps[2].result().success
    assert steps[2].result().message == "the run was reset"
    ros.executor.add_node(machine)


def test_a_reset_begins_anew_on_the_untouched_site(ros: Ros, tmp_path: Path) -> None:
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    scene = digging(ros, tmp_path)
    side = scene.soil.run.endpoint
    run_id, start = side.exchange.run_id, scene.ledgers[0].start
    touched = side.soil.state_hash()
    response = scene.trigger("/sim/reset")
    assert response.success
    assert str(run_id + 1) in response.message
    side = scene.soil.run.endpoint
    assert side.exchange.run_id == run_id + 1
    ros.spin_until(lambda: parse_run_facts(configs[-1].data).run_id == run_id + 1)
    scene.until_tick(20)
    fresh = [ledger for ledger in scene.ledgers if ledger.tick == 0][-1]
    assert fresh.terrain == fresh.start == start
    assert side.soil.total_mm3 == start
    assert side.soil.state_hash() != touched
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}


def test_a_reset_leaves_time_standing_still(ros: Ros) -> None:
    scene = Scene(ros, **ALONE)
    scene.until_tick(3)
    scene.pause()
    scene.trigger("/sim/reset")
    ros.spin_until(lambda: scene.tick == 0)
    assert scene.soil.run.paused
    scene.step()
    assert scene.tick == 1


def test_verify_recounts_and_finds_a_cell_that_was_tampered_with(ros: Ros) -> None:
    scene = Scene(ros, **ALONE)
    scene.until_tick(2)
    good = scene.trigger("/soil/verify")
    assert good.success
    assert str(scene.soil.run.endpoint.soil.total_mm3) in good.message
    scene.soil.run.endpoint.soil.columns.firm[3, 3] -= 1
    assert not scene.trigger("/soil/verify").success


def test_save_writes_the_terrain_as_it_is(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "ground.npz"
    scene = digging(ros, tmp_path, save_path=str(path))
    scene.pause()
    response = scene.trigger("/soil/save")
    assert response.success
    assert str(path) in response.message
    saved = load_terrain(path)
    assert saved.grid == Grid(65, 65, 0.4)
    assert saved.heights == pytest.approx(scene.soil.run.endpoint.soil.columns.height, abs=1e-6)
    assert saved.heights.min() < -0.01


def test_a_map_with_ids_that_no_soil_has_is_refused(ros: Ros, tmp_path: Path) -> None:
    options = {**layered_site(tmp_path), "soil.additional_soils": []}
    with pytest.raises(SoilError, match=r"soil\.additional_soils names 0 kinds"):
        Scene(ros, **options)


def test_save_writes_the_soils_and_the_moisture_too(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "ground.npz"
    scene = digging(ros, tmp_path, save_path=str(path), **layered_site(tmp_path))
    scene.pause()
    response = scene.trigger("/soil/save")
    assert response.message.endswith(str(path))
    _, layers = load_terrain_with_layers(path)
    columns = scene.soil.run.endpoint.soil.columns
    assert np.array_equal(layers.soil, columns.top_soil)
    assert np.array_equal(layers.moisture, columns.moisture)


def test_save_says_where_layers_do_not_go(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "ground.asc"
    scene = Scene(ros, **ALONE, save_path=str(path))
    response = scene.trigger("/soil/save")
    assert response.success
    assert "heights only" in response.message
    assert load_terrain(path).grid == Grid(65, 65, 0.4)


@pytest.mark.parametrize("name", ["no/such/folder/ground.npz", "ground.jpeg"])
def test_save_says_why_it_cannot(ros: Ros, tmp_path: Path, name: str) -> None:
    scene = Scene(ros, **ALONE, save_path=str(tmp_path / name))
    response = scene.trigger("/soil/save")
    assert not response.success
    assert name in response.message
    scene.until_tick(1)


def test_release_is_refused_where_nobody_has_left_anything(ros: Ros) -> None:
    response = Scene(ros, **ALONE).trigger("/soil/release")
    assert not response.success
    assert "no machine" in response.message


def test_release_makes_terrain_of_what_a_machine_left_behind(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, sync="realtime")
    options = {"commands.command_timeout": 60.0, "machine": machine_file(tmp_path, ready_to_dig())}
    machine = scene.machine(**options)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    scene.leave(machine)
    ros.spin_until(lambda: scene.ledgers[-1].absent > 0)
    left = scene.ledgers[-1]
    assert left.absent >= 10**7
    assert scene.trigger("/soil/release").success
    ros.spin_until(lambda: scene.ledgers[-1].absent == 0)
    assert scene.ledgers[-1].terrain == left.terrain + left.absent + left.in_flight == left.start
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
    assert scene.trigger("/soil/verify").success


def test_in_lockstep_with_nobody_left_a_step_does_the_release(ros: Ros, tmp_path: Path) -> None:
    scene = digging(ros, tmp_path)
    scene.leave(next(n for n in ros.executor.get_nodes() if isinstance(n, MachineNode)))
    scene.pause()
    assert scene.trigger("/soil/release").success
    scene.step()
    side = scene.soil.run.endpoint
    assert side.soil.total_mm3 == side.exchange.ledger.start


def test_in_lockstep_what_was_left_behind_is_no_trap_for_who_comes_back(
    ros: Ros, tmp_path: Path
) -> None:
    scene = digging(ros, tmp_path)
    scene.leave(next(n for n in ros.executor.get_nodes() if isinstance(n, MachineNode)))
    assert scene.trigger("/soil/release").success  # no tick until a machine joins
    now = int(time.time())
    ros.spin_until(lambda: int(time.time()) > now, what="the second that begins another life")
    scene.machine(x=-5.0)
    scene.more_ticks(5)
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}

"""Publications of the soil node: terrain, configuration, hashes, cut and fill, QoS."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from nav_msgs.msg import MapMetaData
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, String
from support.node_scenes import TICK, Scene
from support.soil_node_scenes import (
    NO_MACHINES,
    excavating_scene,
    layered_site_parameters,
    write_pit_design,
)

from msg_bridge.codec import qos
from msg_bridge.codec.cut_fill import from_cut_fill_array
from msg_bridge.codec.run_config import parse_run_facts, soil_kinds
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract.grid import Grid
from msg_bridge.testing.ros_context import Ros
from soil_sim.site.cut_fill import compare_to_design
from soil_sim.soils.soil_types import load_soil_types

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
    "/terrain/view": qos.TRANSIENT_LOCAL,
    "/terrain/info": qos.TRANSIENT_LOCAL,
    "/sim/config": qos.TRANSIENT_LOCAL,
    "/sim/paused": qos.TRANSIENT_LOCAL,
}


def test_late_subscriber_gets_terrain_and_configuration(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES, **{"soil.swell": 0.25, "site.terrain": "rough"})
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


def test_map_has_kind_material_and_moisture_of_the_surface(ros: Ros, tmp_path: Path) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = excavating_scene(ros, tmp_path, map_rate=20.0, **layered_site_parameters(tmp_path))
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
    assert (newest.moisture == soil.columns.top_moisture).all()


def test_configuration_has_the_properties_of_each_soil_id(ros: Ros, tmp_path: Path) -> None:
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    Scene(ros, **NO_MACHINES, **layered_site_parameters(tmp_path))
    ros.spin_until(lambda: configs)
    shipped = load_soil_types()
    kinds = soil_kinds(configs[0].data)
    assert [kind.name for kind in kinds] == ["dry sand", "dry clay"]
    for kind in kinds:
        expected = shipped[kind.name]
        assert (kind.colour, kind.swell, kind.density) == (
            expected.colour,
            expected.swell,
            expected.density,
        )
        assert kind.repose_angles[1] == expected.repose_angle_damp
    loose = [shipped[kind.name].loose_soil for kind in kinds]
    assert list(parse_run_facts(configs[0].data).soils) == loose


def test_soil_defined_by_parameters_has_no_name(ros: Ros) -> None:
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    Scene(ros, **NO_MACHINES, **{"soil.swell": 0.25, "soil.repose_angle": 40.0})
    ros.spin_until(lambda: configs)
    (kind,) = soil_kinds(configs[0].data)
    assert (kind.name, kind.swell, kind.repose_angles) == ("", 0.25, (40.0, 40.0, 40.0))


def test_cut_and_fill_volumes_follow_the_excavation(ros: Ros, tmp_path: Path) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = excavating_scene(
        ros, tmp_path, map_rate=20.0, **{"site.design": write_pit_design(tmp_path)}
    )
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
    published = from_terrain_cloud(maps[-1]).design_difference
    assert np.array_equal(published, expected.difference, equal_nan=True)
    publisher = next(p for p in scene.soil.publishers if p.topic_name == "/soil/cut_fill")
    assert publisher.qos_profile.durability == qos.TRANSIENT_LOCAL.durability


def test_unchanged_cut_and_fill_volumes_are_published_once(ros: Ros, tmp_path: Path) -> None:
    received = ros.collect("/soil/cut_fill", Float64MultiArray, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **NO_MACHINES, map_rate=20.0, **{"site.design": write_pit_design(tmp_path)})
    scene.until_tick(20)
    (state,) = map(from_cut_fill_array, received)
    assert state == (0.0, pytest.approx(28.8), 0.0, pytest.approx(28.8), 0.0)


def test_reset_restores_cut_volume_soils_and_moisture(ros: Ros, tmp_path: Path) -> None:
    received = ros.collect("/soil/cut_fill", Float64MultiArray, qos.TRANSIENT_LOCAL)
    options = {**layered_site_parameters(tmp_path), "site.design": write_pit_design(tmp_path)}
    scene = excavating_scene(ros, tmp_path, map_rate=20.0, **options)
    ros.spin_until(lambda: from_cut_fill_array(received[-1]).cut < 28.7)
    scene.trigger("/sim/reset")
    ros.spin_until(lambda: from_cut_fill_array(received[-1]).cut == pytest.approx(28.8, abs=1e-9))
    columns = scene.soil.run.endpoint.soil.columns
    assert (columns.soil[:, 30:] == 1).all()
    assert (columns.moisture[64] == 64).all()


def test_surface_tilt_is_published_within_its_noise_amplitude(ros: Ros) -> None:
    received = ros.collect("/terrain/surface_tilt", Image, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **NO_MACHINES, **{"soil.surface_tilt_noise": 8.0})
    ros.spin_until(lambda: received)
    rows, cols = scene.soil.run.endpoint.soil.grid.shape
    image = received[0]
    assert (image.encoding, image.height, image.width) == ("32FC2", rows, cols)
    slopes = np.frombuffer(image.data, "<f4").reshape(rows, cols, 2)
    assert 0.1 < np.abs(slopes).max() <= math.tan(math.radians(8.0)) + 1e-6
    assert abs(slopes.mean()) < 0.01


def test_each_topic_has_its_qos_profile(ros: Ros) -> None:
    scene = Scene(ros)
    profiles = {publisher.topic_name: publisher.qos_profile for publisher in scene.soil.publishers}
    for topic, expected in PROFILES.items():
        actual = profiles[topic]
        assert (actual.depth, actual.reliability, actual.durability, actual.history) == (
            expected.depth,
            expected.reliability,
            expected.durability,
            expected.history,
        ), topic
    assert set(profiles) - set(PROFILES) <= {
        "/parameter_events",
        "/rosout",
        "/diagnostics",
        "/terrain/grid_map",
    }


def test_hashes_are_published_at_hash_rate_and_unchanged_maps_once(ros: Ros) -> None:
    hashes = ros.collect("/soil/state_hash", String, qos.STATE)
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **NO_MACHINES, hash_rate=1.0 / (5 * TICK), map_rate=20.0)
    scene.until_tick(31)
    decoded = [from_state_hash_string(message) for message in hashes]
    ticks = [each.tick for each in decoded]
    assert ticks[-1] >= 30
    assert all(tick % 5 == 0 for tick in ticks)
    assert {each.sha256 for each in decoded} == {scene.soil.run.endpoint.soil.state_hash()}
    assert {each.run_id for each in decoded} == {scene.soil.run.endpoint.exchange.run_id}
    assert [tick_from_stamp(each.stamp, TICK) for each in decoded] == ticks
    assert len(maps) == 1


def test_maps_follow_the_excavation(ros: Ros, tmp_path: Path) -> None:
    maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = excavating_scene(ros, tmp_path, map_rate=20.0)
    scene.more_ticks(10)
    scene.pause()
    soil = scene.soil.run.endpoint.soil
    ros.spin_until(lambda: from_terrain_cloud(maps[-1]).keyframe.revision == soil.revision)
    newest = from_terrain_cloud(maps[-1])
    assert (newest.keyframe.elevation == soil.columns.height.astype(np.float32)).all()
    assert newest.volume_mm3.sum() == soil.total_mm3

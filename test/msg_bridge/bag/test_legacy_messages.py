"""Bags of format 1 are read by current names; current messages are not changed."""

import array
import json
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Int64MultiArray, MultiArrayDimension, MultiArrayLayout, String

from msg_bridge.bag.legacy_messages import RecordedRun, upgrade_message
from msg_bridge.bag.legacy_names import current_topic
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.codec.row_chunks import chunk_dtype
from msg_bridge.codec.run_config import RunFacts, parse_run_facts, to_config_yaml
from msg_bridge.codec.state_hash import StateHash, from_state_hash_string
from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.codec.tick_headers import from_multi_array, to_multi_array
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import (
    MachineHeader,
    MachineReceipt,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import UNLIMITED_ROOM

RUN = RecordedRun(9, 0.01)
ROWS = "sensor_msgs/msg/PointCloud2"


def labelled(label: str, *values: int) -> Int64MultiArray:
    size = len(values)
    dimension = MultiArrayDimension(label=label, size=size, stride=size)
    return Int64MultiArray(
        layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=array.array("q", values)
    )


@pytest.mark.parametrize(
    ("recorded", "type_name", "current"),
    [
        ("/soil/landed", ROWS, "/soil/deposit_requests"),
        ("/terrain/changes", ROWS, "/terrain/map_updates"),
        ("/soil/refusals", "std_msgs/msg/String", "/soil/join_rejections"),
        ("/site/digger/soil_owed", ROWS, "/site/digger/conversion_backlog"),
        ("/excavator/encoders", "sensor_msgs/msg/JointState", "/excavator/joint_states_measured"),
        ("/excavator/imu/base_link", "sensor_msgs/msg/Imu", "/excavator/imu/base_link/data"),
        ("/excavator/imu/base_link/data", "sensor_msgs/msg/Imu", "/excavator/imu/base_link/data"),
        ("/soil/tick", "std_msgs/msg/Int64MultiArray", "/soil/tick"),
        ("/clock", "rosgraph_msgs/msg/Clock", "/clock"),
    ],
)
def test_topic_has_its_current_name(recorded: str, type_name: str, current: str) -> None:
    assert current_topic(recorded, type_name) == current


def test_point_fields_of_rows_are_renamed() -> None:
    names = ("x", "seq", "source", "holds", "epoch", "life")
    cloud = PointCloud2(fields=[PointField(name=name) for name in names])
    upgrade_message("/soil/forces", cloud)
    renamed = ["x", "seq", "machine_id", "reaction", "run_id", "session_id"]
    assert [field.name for field in cloud.fields] == renamed


def test_moisture_of_terrain_maps_is_converted_to_per_cent() -> None:
    cell = np.dtype([("z", "<f4"), ("moisture", "<f4"), ("epoch", "<u4")])
    cells = np.zeros(101, cell)
    cells["z"], cells["moisture"] = 0.5, np.arange(101) / 100.0
    cloud = to_point_cloud(cells, "map", Time(), height=1)
    upgraded = upgrade_message("/terrain/map", cloud)
    points = from_point_cloud(
        upgraded, np.dtype([("z", "<f4"), ("moisture", "<f4"), ("run_id", "<u4")])
    )
    assert points["moisture"].tolist() == list(range(101))
    assert set(points["z"].tolist()) == {0.5}


def test_point_fields_of_other_clouds_are_kept() -> None:
    cloud = PointCloud2(fields=[PointField(name=name) for name in ("x", "source")])
    upgrade_message("/lidar", cloud)
    assert [field.name for field in cloud.fields] == ["x", "source"]


def test_soil_header_is_upgraded() -> None:
    message = labelled(
        "kind,epoch,tick,revision,conversions.first,conversions.count,changed.first,changed.count,"
        "forces.first,forces.count,receipts.0.source,receipts.0.life,receipts.0.landed_received,"
        "receipts.0.landed_durable,receipts.0.owed,receipts.0.tick",
        *(2, 9, 5, 3, 1, 2, 3, 4, 5, 6, 1, 7, 12, 11, 4, 5),
    )
    header = from_multi_array(upgrade_message("/soil/tick", message))
    assert isinstance(header, SoilHeader)
    assert (header.run_id, header.tick, header.map_updates) == (9, 5, RowRange(3, 4))
    (receipt,) = header.receipts
    assert (receipt.machine_id, receipt.session_id, receipt.backlog, receipt.tick) == (1, 7, 4, 5)
    assert receipt.deposit_requests_received == 12


def test_ledger_gets_the_number_of_its_run_and_the_end_time_of_its_tick() -> None:
    label = "kind,tick,terrain,in_flight,pending,particles,absent,outside,start,imbalance"
    message = labelled(label, 4, 150, 10, 20, 30, 40, 50, 60, 210, 0)
    ledger = from_multi_array(upgrade_message("/soil/ledger", message, lambda: RUN))
    assert isinstance(ledger, Ledger)
    assert (ledger.run_id, ledger.tick, ledger.stamp_sec, ledger.stamp_nanosec) == (
        *(9, 150),
        *(1, 500_000_000),
    )
    assert (ledger.terrain, ledger.outside, ledger.start) == (10, 60, 210)
    current = deepcopy(message)
    assert upgrade_message("/soil/ledger", message, lambda: RUN) == current


def test_state_hash_gets_the_number_of_its_run_and_the_end_time_of_its_tick() -> None:
    message = String(data=f"150 {64 * 'a'}")
    upgrade_message("/soil/state_hash", message, lambda: RUN)
    found = from_state_hash_string(message)
    assert found == StateHash(9, 150, Time(sec=1, nanosec=500_000_000), 64 * "a")


def test_machine_header_is_upgraded() -> None:
    message = labelled(
        "kind,epoch,source,life,tick,verb,sweeps.first,sweeps.count,landed.first,landed.count,"
        "conversions_received,conversions_durable,pending_mm3,particles_mm3,previous",
        *(1, 9, 1, 7, 5, 2, 1, 2, 3, 4, 20, 19, 100, 200, 4),
    )
    header = from_multi_array(upgrade_message("/excavator/soil_tick", message))
    assert isinstance(header, MachineHeader)
    assert (header.run_id, header.machine_id, header.session_id) == (9, 1, 7)
    assert (header.verb, header.deposit_requests) == (Verb.STEP, RowRange(3, 4))
    assert (header.conversions_received, header.previous_tick) == (20, 4)
    assert header.soil_mm3 == 300


@pytest.mark.parametrize(
    ("topic", "recorded", "current"),
    [
        (
            "/excavator/operator/phase",
            {"time": 1.0, "cycle": 1, "phase": "dig", "given_up": "stuck"},
            {"time": 1.0, "cycle": 1, "phase": "dig", "abort_reason": "stuck"},
        ),
        (
            "/excavator/operator/cycles",
            {"number": 1, "passes": 2, "planned": 1.0, "carried": 0.9, "left": 0.1, "moved": 0.8},
            {
                "number": 1,
                "num_passes": 2,
                "planned_volume": 1.0,
                "carried_fill": 0.9,
                "residual_fill": 0.1,
                "moved_volume": 0.8,
            },
        ),
        ("/recorder/status", {"gaps": 3, "lost": {}}, {"num_lost": 3, "lost": {}}),
        ("/chatter", {"gaps": 3}, {"gaps": 3}),
    ],
)
def test_json_keys_are_renamed(
    topic: str, recorded: dict[str, Any], current: dict[str, Any]
) -> None:
    message = upgrade_message(topic, String(data=json.dumps(recorded)))
    assert json.loads(message.data) == current


def test_configuration_is_upgraded_with_its_values() -> None:
    soil = {"swell": 0.15, "stick": [1.0, 1.2, 0.9], "spread": 0.5, "shear_modulus": 0.02}
    config = {
        "run": {"epoch": 9, "tick": 0.05, "sync": "lockstep", "cell": 0.5, "soils": [soil]},
        "soil_sim": {"tick": 0.05, "await_listeners": ["recorder", "rviz"]},
        "machine_sim": {"await_commands_every": 2},
        "machines": {"digger": {"await_commands_every": 3}},
        "stepping": {"tracks": "physics", "load_acts": True},
    }
    text = upgrade_message("/site/config", String(data=yaml.safe_dump(config))).data
    facts = parse_run_facts(text)
    assert (facts.run_id, facts.tick_period) == (9, 0.05)
    assert facts.soils[0].moisture_strength_factors == (1.0, 1.2, 0.9)
    assert facts.soils[0].janosi_k == 0.02
    upgraded = yaml.safe_load(text)
    assert upgraded["soil_sim"]["required_subscribers"] == ["exchange_recorder", "rviz"]
    assert upgraded["stepping"] == {"track_model": "dynamic", "payload_coupling": True}
    assert upgraded["machines"]["digger"] == {"command_wait_period": 3}


def test_diagnostics_are_upgraded() -> None:
    values = [KeyValue(key="gaps", value="2"), KeyValue(key="topics", value="9")]
    recorder = DiagnosticStatus(name="recorder", values=values)
    operator = DiagnosticStatus(name="excavator/operator: operator")
    upgrade_message("/diagnostics", DiagnosticArray(status=[recorder, operator]))
    assert recorder.name == "exchange_recorder"
    assert [value.key for value in recorder.values] == ["num_lost", "topics"]
    assert operator.name == "excavator/dig_operator: dig_operator"


FACTS = RunFacts(1, 0.01, False, 0.2, (LooseSoil(0.15),))
RECEIPT = MachineReceipt(1, 2, 3)


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("/sim/config", String(data=to_config_yaml(FACTS, {"soil_sim": {"tick": 1}}))),
        ("/sim/config", String(data="neither: YAML of a configuration")),
        ("/excavator/operator/phase", String(data="no JSON")),
        ("/chatter", labelled("kind,epoch", 1)),
        (
            "/soil/tick",
            to_multi_array(SoilHeader(1, 2, 3, RowRange(), RowRange(), RowRange(), (RECEIPT,))),
        ),
    ],
)
def test_messages_of_the_current_format_are_not_changed(topic: str, message: Any) -> None:
    before = deepcopy(message)
    assert upgrade_message(topic, message) == before


@pytest.mark.parametrize(
    ("topic", "dtype", "added"),
    [
        (
            "/plant/soil/tool_sweeps",
            chunk_dtype(Stream.SWEEP),
            {"room_mm3": UNLIMITED_ROOM, "work": 0.0, "pressure": 0.0},
        ),
        ("/plant/terrain/map_updates", chunk_dtype(Stream.MAP_UPDATE), {"rut_depth": 0.0}),
        ("/plant/terrain/map", TERRAIN_CELL, {"rut_depth": 0.0}),
    ],
)
def test_rows_without_an_added_field_get_its_value(
    topic: str, dtype: np.dtype[np.void], added: dict[str, float]
) -> None:
    old = np.dtype([(name, dtype[name]) for name in dtype.names or () if name not in added])
    points = np.zeros(3, old)
    for n, name in enumerate(old.names or ()):
        points[name] = [n + 1, 2 * n, 7]
    cloud = to_point_cloud(points, "map", Time())
    rows = from_point_cloud(upgrade_message(topic, cloud), dtype)
    for name in old.names or ():
        assert rows[name].tolist() == points[name].tolist(), name
    for name, value in added.items():
        assert (rows[name] == value).all()

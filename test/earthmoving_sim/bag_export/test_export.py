"""Tables have every message once, exact values, and units."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from builtin_interfaces.msg import Time
from mcap.writer import Writer
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import (
    Float64MultiArray,
    Header,
    Int64MultiArray,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)
from support.recorded_messages import Recording

from earthmoving_sim.bag_export import BagExport, export_bag
from earthmoving_sim.bag_export.cloud_tables import CloudTable
from earthmoving_sim.bag_export.parquet_file import ExportError
from earthmoving_sim.cli import main
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.reader import BagReader
from msg_bridge.bag.writer import BagWriter

BAGS = Path(__file__).parents[3] / "bags"


def export(path: Path, folder: Path, **options: Any) -> BagExport:
    return export_bag(BagReader(path), folder, **options)


def array(kind: type, label: str, values: list[float]) -> Any:
    dimension = MultiArrayDimension(label=label, size=len(values), stride=len(values))
    return kind(layout=MultiArrayLayout(dim=[dimension]), data=values)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of a recorded dig."""
    folder = tmp_path_factory.mktemp("export") / "tables"
    assert export(BAGS / "format_2", folder).is_complete
    return folder


def test_volumes_are_those_of_the_audit(tables: Path) -> None:
    table = pq.read_table(tables / "soil/conversions.parquet")
    assert table.schema.field("volume_mm3").type == pa.uint32()
    assert table.schema.field("volume_mm3").metadata == {b"unit": b"mm^3"}
    assert table.schema.metadata[b"topic"] == b"/soil/conversions"
    (run,) = audit_bag(BAGS / "format_2").runs
    sums = table.group_by("kind").aggregate([("volume_mm3", "sum")]).to_pydict()
    by_kind = dict(zip(sums["kind"], sums["volume_mm3_sum"], strict=True))
    names = ["EXCAVATE", "DEPOSIT", "OUTSIDE"]
    assert [by_kind[kind] for kind in range(3)] == [run.moved_mm3[name] for name in names]


def test_ledger_has_a_column_for_each_label(tables: Path) -> None:
    ledger = pq.read_table(tables / "soil/ledger.parquet")
    assert ledger.schema.field("in_flight").type == pa.int64()
    assert ledger.schema.field("in_flight").metadata == {b"unit": b"mm^3"}
    assert pc.max(pc.abs(ledger["imbalance"])).as_py() == 0
    headers = pq.read_table(tables / "soil/tick.parquet")  # with requests to retransmit
    kinds = headers.group_by("kind").aggregate([("revision", "count")]).to_pydict()
    assert dict(zip(kinds["kind"], kinds["revision_count"], strict=True))[3] == 0


def test_json_texts_have_a_column_for_each_key(tables: Path) -> None:
    cycles = pq.read_table(tables / "excavator/operator/cycles.parquet")
    assert cycles.schema.field("moved_volume").metadata == {b"unit": b"m^3"}
    assert cycles["moved_volume"].to_pylist() == [pytest.approx(0.569, abs=1e-3)]
    config = pq.read_table(tables / "sim/config.parquet")  # YAML
    assert config.column_names == ["log_time", "data"]


def test_maps_are_the_first_and_the_last_one_by_default(tables: Path) -> None:
    terrain = pq.read_table(tables / "terrain/map.parquet")
    assert len(pc.unique(terrain["log_time"])) == 2
    assert terrain.num_rows == 2 * (pc.max(terrain["row"]).as_py() + 1) ** 2


def test_rows_that_were_sent_again_are_exported_once() -> None:
    dtype = np.dtype([("seq", "<u4"), ("run_id", "<u4"), ("volume_mm3", "<u4")])

    def cloud(run_id: int, numbers: list[int]) -> PointCloud2:
        rows = np.zeros(len(numbers), dtype)
        rows["seq"], rows["run_id"] = numbers, run_id
        fields = [
            PointField(name=name, offset=4 * k, datatype=6, count=1)
            for k, name in enumerate(dtype.names or ())
        ]
        message = PointCloud2(
            height=1, width=rows.size, fields=fields, point_step=12, row_step=12 * rows.size
        )
        message.data.frombytes(rows.tobytes())
        return message

    sent = [[1, 2, 3], [7, 8], [3, 4, 5], [4, 5, 6], [9], [1, 9, 10]]
    table = CloudTable(cloud(1, sent[0]))
    for numbers in sent:
        assert table.add(0, cloud(1, numbers))
    assert table.add(0, cloud(2, [1, 2]))
    assert table.take()["seq"].to_pylist() == [1, 2, 3, 7, 8, 4, 5, 6, 9, 10, 1, 2]


def test_repeated_transient_local_messages_are_exported_once(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    for topic, durability in (("/kept", "transient_local"), ("/sent", "volatile")):
        writer.add_topic(topic, "std_msgs/msg/String", [OfferedQos(durability=durability)])
        for time, text in enumerate(["a", "a", "b", "b", "a"]):
            writer.write(topic, serialize_message(String(data=text)), time, time)
    writer.close()
    export(tmp_path / "bag", tmp_path / "tables")
    assert pq.read_table(tmp_path / "tables/kept.parquet")["data"].to_pylist() == ["a", "b", "a"]
    assert pq.read_table(tmp_path / "tables/sent.parquet").num_rows == 5


def test_type_that_is_not_installed_is_decoded_by_its_definition_in_the_bag(tmp_path: Path) -> None:
    inner, outer = "other_msgs/msg/Point", "other_msgs/msg/Thing"
    text = (
        f"other_msgs/Point[] points\nother_msgs/Point origin\nstring name\nuint8[] blob\n"
        f"float32[3] sizes\n{80 * '='}\nMSG: other_msgs/Point\nint64 x\nfloat64 y\n"
    )
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, outer))
    point, thing = store.types[inner], store.types[outer]
    blob, sizes = np.arange(3, dtype=np.uint8), np.ones(3, dtype=np.float32)
    message = thing([point(1, 2.0), point(3, 4.0)], point(2**62, 0.5), "one", blob, sizes)
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        mcap = Writer(stream)
        mcap.start(profile="ros2")
        schema = mcap.register_schema(outer, "ros2msg", text.encode())
        channel = mcap.register_channel("/thing", "cdr", schema)
        mcap.add_message(channel, 10**18 + 1, bytes(store.serialize_cdr(message, outer)), 0)
        mcap.finish()
    assert export(path, tmp_path / "tables").is_complete
    table = pq.read_table(tmp_path / "tables/thing.parquet")
    assert table["log_time"][0].value == 10**18 + 1
    (row,) = table.drop_columns(["log_time"]).to_pylist()
    assert row == {
        "points": [{"x": 1, "y": 2.0}, {"x": 3, "y": 4.0}],
        "origin.x": 2**62,
        "origin.y": 0.5,
        "name": "one",
        "blob": b"\x00\x01\x02",
        "sizes": [1.0, 1.0, 1.0],
    }


def test_what_cannot_be_exported_is_named_and_the_rest_is(tmp_path: Path) -> None:
    recording = Recording()
    for number in range(40):
        joints = JointState(name=["boom", "arm"], position=[0.5 * number, 1.0], effort=[7.0])
        joints.header = Header(stamp=Time(sec=number))
        recording.add("/m/joint_states", joints)
        recording.add("/m/payload", array(Float64MultiArray, "time_s,bank_m3", [number, 0.5]))
        recording.add(
            "/odd", array(Int64MultiArray, "a,b", [1, 2]) if number else Int64MultiArray()
        )
    path = recording.write(tmp_path / "bag.mcap")
    result = {each.topic: each for each in export(path, tmp_path / "tables").topics}
    joints = pq.read_table(tmp_path / "tables/m/joint_states.parquet").to_pylist()
    assert [(each["joint"], each["position"], each["effort"]) for each in joints[2:4]] == [
        ("boom", 0.5, 7.0),
        ("arm", 1.0, None),
    ]
    payload = pq.read_table(tmp_path / "tables/m/payload.parquet")
    assert payload.schema.field("bank_m3").metadata == {b"unit": b"m^3"}
    # An array without labels: the topic has one row for each message, of any layout.
    assert result["/odd"].num_rows == 40
    assert "layout.data_offset" in pq.read_schema(tmp_path / "tables/odd.parquet").names


def test_names_that_the_table_has_already_are_changed(tmp_path: Path) -> None:
    recording = Recording()
    recording.add("/json", String(data=json.dumps({"log_time": 1.5, "b": 2})))
    recording.add("/array", array(Int64MultiArray, "log_time,b", [3, 4]))
    cloud = PointCloud2(height=1, width=1, point_step=12, row_step=12, is_bigendian=True)
    cloud.fields = [
        PointField(name="stamp", offset=0, datatype=5, count=1),
        PointField(name="xyz", offset=4, datatype=4, count=3),
    ]
    cloud.data.frombytes(
        b"".join([(7).to_bytes(4, "big"), *(n.to_bytes(2, "big") for n in (1, 2, 3, 0))])
    )
    recording.add("/cloud", cloud)
    assert export(recording.write(tmp_path / "bag.mcap"), tmp_path / "tables").is_complete
    rows = {
        name: pq.read_table(tmp_path / f"tables/{name}.parquet").drop_columns(["log_time"])
        for name in ("json", "array", "cloud")
    }
    assert rows["json"].to_pylist() == [{"log_time_": 1.5, "b": 2}]
    assert rows["array"].to_pylist() == [{"log_time_": 3, "b": 4}]
    (point,) = rows["cloud"].drop_columns(["stamp"]).to_pylist()
    assert point == {"stamp_": 7, "xyz": [1, 2, 3]}


def test_bag_that_was_cut_off_is_exported_as_far_as_it_goes(tmp_path: Path) -> None:
    recording = Recording()
    for number in range(3000):
        recording.add("/texts", String(data=f"{number} " * 20))
    folder = recording.write_folder(tmp_path / "bag", finish=False)
    result = export(folder, tmp_path / "tables")
    assert result.truncated
    table = pq.read_table(tmp_path / "tables/texts.parquet")
    assert table["data"].to_pylist() == [f"{n} " * 20 for n in range(table.num_rows)]
    assert table.num_rows > 1000


def test_command_exports_several_bags_and_no_file_is_left_incomplete(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bags = [str(BAGS / name) for name in ("format_1", "format_2")]
    options = ["--output", str(tmp_path), "--include", "payload|ledger", "--json"]
    assert main(["export", *bags, *options]) == 0
    reports = json.loads(capsys.readouterr().out)
    assert [each["topics"][0]["topic"] for each in reports] == 2 * ["/soil/ledger"]
    ledgers = [
        pq.read_table(tmp_path / f"bag={Path(bag).name}/soil/ledger.parquet") for bag in bags
    ]
    assert ledgers[0].drop_columns(["log_time"]).column_names == (
        ledgers[1].drop_columns(["log_time"]).column_names
    )
    assert main(["export", bags[0], "--output", str(tmp_path)]) == 2  # the folder is not empty

    def fail(*args: object, **kwargs: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pq.ParquetWriter, "write_table", fail)
    with pytest.raises(ExportError, match="no disk space"):
        export(BAGS / "format_2", tmp_path / "full")
    assert not [path for path in (tmp_path / "full").rglob("*") if path.is_file()]


@pytest.mark.parametrize("options", ["--include /b", "--exclude /a --maps none"])
def test_bag_without_selected_messages_is_an_error_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: str
) -> None:
    bags = []
    for name in ("b", "a"):
        recording = Recording()
        recording.add(f"/{name}", String(data="text"))
        recording.add("/terrain/map", PointCloud2())
        bags.append(str(recording.write(tmp_path / f"bag_{name}.mcap")))
    tables = tmp_path / "tables"
    assert main(["export", *bags, "-o", str(tables), *options.split()]) == 2
    error = capsys.readouterr().err
    assert "bag_a.mcap has no message to export" in error
    assert "/terrain/map" in error
    assert not tables.exists()


def test_former_export_is_overwritten_only_on_request_and_other_files_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = Recording()
    for topic in ("/a", "/b/c"):
        recording.add(topic, String(data="text"))
    bag = str(recording.write(tmp_path / "bag.mcap"))
    folder = tmp_path / "tables/bag=bag"
    command = ["export", bag, "-o", str(folder.parent), "--include"]
    assert main([*command, "/b"]) == 0
    assert main([*command, "/a"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    (folder / "killed.part").write_bytes(b"PAR1")
    assert main([*command, "/a", "--overwrite"]) == 0
    assert [path.name for path in folder.rglob("*")] == ["a.parquet"]
    pq.write_table(pa.table({"mine": [1]}), folder / "mine.parquet")
    assert main([*command, "/b", "--overwrite"]) == 2
    assert "mine.parquet was not made by an export" in capsys.readouterr().err
    assert {path.name for path in folder.rglob("*")} == {"a.parquet", "mine.parquet"}

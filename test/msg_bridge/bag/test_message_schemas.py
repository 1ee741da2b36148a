"""Schemas contain all that a reader without ROS needs; hashes are those of the installed types."""

import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msg_bridge.bag.bundled_types import BUNDLED_TYPES
from msg_bridge.bag.message_schemas import SchemaError, schema_text, type_hash

TYPES = [
    "std_msgs/msg/String",
    "std_msgs/msg/Int64MultiArray",
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/JointState",
    "nav_msgs/msg/Odometry",
    "visualization_msgs/msg/MarkerArray",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rosgraph_msgs/msg/Clock",
    "rcl_interfaces/msg/ParameterEvent",
    "rcl_interfaces/msg/Log",
]


@pytest.mark.parametrize("name", TYPES)
def test_schema_defines_every_type_in_it(name):
    parts = schema_text(name).split("=" * 80 + "\n")
    assert parts[0] == own_text(name).rstrip("\n") + "\n"
    for part in parts[1:]:
        title, text = part.split("\n", 1)
        package, used = title.removeprefix("MSG: ").split("/")
        assert text == own_text(f"{package}/msg/{used}").rstrip("\n") + "\n"
    defined = get_types_from_msg(schema_text(name), name)
    store = get_typestore(Stores.ROS2_JAZZY)
    assert defined == {each: store.fielddefs[each] for each in defined}
    assert name in defined


def own_text(name: str) -> str:
    package, _, short = name.split("/")
    return Path(sys.prefix, "share", package, "msg", f"{short}.msg").read_text()


@pytest.mark.parametrize("name", TYPES)
def test_hash_equals_that_computed_from_the_definition(name):
    assert type_hash(name) == get_typestore(Stores.ROS2_JAZZY).hash_rihs01(name)


@pytest.mark.parametrize("name", BUNDLED_TYPES)
def test_type_without_its_package_has_a_schema_and_its_hash(name, monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    store = get_typestore(Stores.ROS2_JAZZY)
    defined = get_types_from_msg(schema_text(name), name)
    assert name in defined
    store.register({each: fields for each, fields in defined.items() if each not in store.types})
    assert type_hash(name) == store.hash_rihs01(name)


@pytest.fixture
def overlay(tmp_path, monkeypatch):
    """A workspace with one package that overlays the installation."""
    folder = tmp_path / "share/dig_msgs/msg"
    folder.mkdir(parents=True)
    (folder / "Scoop.msg").write_text(
        "# std_msgs/Nothing\nuint8 FULL=1\nstring<=10 text 'a # b'\nTooth[<=9] teeth # own\n"
        "std_msgs/Header header\nuint8[16] id\n"
    )
    (folder / "Tooth.msg").write_text("float64 wear\nstd_msgs/Header header\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    return folder


def test_dependencies_in_any_notation_are_included_once(overlay):
    titles = [line for line in schema_text("dig_msgs/msg/Scoop").splitlines() if "MSG:" in line]
    assert titles == ["MSG: dig_msgs/Tooth", "MSG: std_msgs/Header", "MSG: builtin_interfaces/Time"]


def test_error_about_a_missing_type_lists_the_searched_files(overlay):
    with pytest.raises(SchemaError, match=r"install other_msgs(.|\n)*/nowhere/share/other_msgs"):
        schema_text("other_msgs/msg/Thing")


def test_missing_dependency_is_an_error(overlay):
    (overlay / "Tooth.msg").unlink()
    with pytest.raises(SchemaError, match="dig_msgs/msg/Tooth is not installed"):
        schema_text("dig_msgs/msg/Scoop")


def test_missing_or_invalid_hash_is_an_error(overlay):
    with pytest.raises(SchemaError):
        type_hash("dig_msgs/msg/Scoop")
    for content in ("{}", "nothing", '{"type_hashes": []}'):
        (overlay / "Scoop.json").write_text(content)
        with pytest.raises(SchemaError, match=r"Scoop\.json"):
            type_hash("dig_msgs/msg/Scoop")


@pytest.mark.parametrize("name", ["std_msgs/String", "std_srvs/srv/Trigger_Event", "String", ""])
def test_invalid_name_of_a_message_type_is_an_error(name):
    with pytest.raises(SchemaError, match=repr(name)):
        schema_text(name)

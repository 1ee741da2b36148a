"""Rows are transmitted as PointCloud2 bit by bit; malformed clouds are rejected."""

import array
from collections.abc import Callable

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from sensor_msgs.msg import PointCloud2, PointField
from support.wire import over_the_wire, raises, random_rows, with_extra_fields

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    FORCE,
    MAP_UPDATE,
    SWEEP,
    Rows,
    empty_rows,
)

ROW_TYPES = {
    "sweep": SWEEP,
    "deposit_requests": DEPOSIT_REQUEST,
    "conversion": CONVERSION,
    "map_updates": MAP_UPDATE,
    "force": FORCE,
}
STAMP = Time(sec=3, nanosec=40_000_000)


def transmitted(rows: Rows) -> Rows:
    msg = over_the_wire(to_point_cloud(rows, "map", STAMP))
    return from_point_cloud(msg, rows.dtype)


@pytest.mark.parametrize("name", ROW_TYPES)
@given(data=st.data())
def test_every_row_type_is_transmitted_bit_by_bit(name: str, data: st.DataObject) -> None:
    rows = data.draw(hnp.arrays(ROW_TYPES[name], st.integers(0, 5)))
    assert transmitted(rows).tobytes() == rows.tobytes()


@pytest.mark.parametrize("dtype", ROW_TYPES.values(), ids=ROW_TYPES)
def test_extreme_values_are_transmitted_unchanged(dtype: np.dtype[np.void]) -> None:
    rows = empty_rows(dtype, 2)
    for name in dtype.names or ():
        kind = dtype[name]
        limits = np.finfo(kind) if kind.kind == "f" else np.iinfo(kind)
        rows[name] = limits.min, limits.max
    assert transmitted(rows).tolist() == rows.tolist()


@pytest.mark.parametrize("dtype", ROW_TYPES.values(), ids=ROW_TYPES)
def test_empty_rows_are_transmitted(dtype: np.dtype[np.void]) -> None:
    rows = transmitted(empty_rows(dtype))
    assert rows.shape == (0,)
    assert rows.dtype == dtype


@pytest.mark.parametrize("dtype", ROW_TYPES.values(), ids=ROW_TYPES)
def test_many_rows_are_transmitted(dtype: np.dtype[np.void]) -> None:
    rows = random_rows(dtype, 100_000)
    assert transmitted(rows).tobytes() == rows.tobytes()


def test_strided_array_is_transmitted() -> None:
    rows = random_rows(CONVERSION, 10)[::2]
    assert transmitted(rows).tobytes() == rows.tobytes()


def test_cloud_describes_its_points() -> None:
    msg = over_the_wire(to_point_cloud(random_rows(MAP_UPDATE, 3), "map", STAMP))
    assert [(f.name, f.offset, f.datatype, f.count) for f in msg.fields] == [
        ("x", 0, PointField.FLOAT32, 1),
        ("y", 4, PointField.FLOAT32, 1),
        ("z", 8, PointField.FLOAT32, 1),
        ("loose_depth", 12, PointField.FLOAT32, 1),
        ("volume_mm3", 16, PointField.FLOAT64, 1),
        ("row", 24, PointField.UINT32, 1),
        ("col", 28, PointField.UINT32, 1),
        ("revision", 32, PointField.UINT32, 1),
        ("seq", 36, PointField.UINT32, 1),
        ("soil", 40, PointField.UINT8, 1),
        ("moisture", 41, PointField.UINT8, 1),
        ("rut_depth", 42, PointField.FLOAT32, 1),
    ]
    assert (msg.height, msg.width, msg.point_step, msg.row_step) == (1, 3, 46, 138)
    assert (msg.header.frame_id, msg.header.stamp) == ("map", STAMP)


def test_small_fields_keep_their_types() -> None:
    fields = {
        f.name: f.datatype for f in to_point_cloud(empty_rows(DEPOSIT_REQUEST), "map", STAMP).fields
    }
    assert fields["machine_id"] == PointField.UINT16
    assert fields["soil"] == PointField.UINT8


def test_organised_cloud_has_rows_and_columns() -> None:
    rows = random_rows(MAP_UPDATE, 6)
    msg = to_point_cloud(rows, "map", STAMP, height=2)
    assert (msg.height, msg.width, msg.row_step) == (2, 3, 138)
    assert from_point_cloud(msg, MAP_UPDATE).tobytes() == rows.tobytes()


def test_receiving_copies_nothing() -> None:
    msg = over_the_wire(to_point_cloud(random_rows(CONVERSION, 10), "map", STAMP))
    rows = from_point_cloud(msg, CONVERSION)
    assert np.shares_memory(rows, np.frombuffer(msg.data, dtype=np.uint8))


def test_received_rows_are_read_only() -> None:
    rows = from_point_cloud(to_point_cloud(empty_rows(FORCE, 1), "map", STAMP), FORCE)
    with pytest.raises(ValueError, match="read-only"):
        rows["seq"] = 1


def test_sent_rows_may_be_changed_afterwards() -> None:
    rows = empty_rows(FORCE, 1)
    msg = to_point_cloud(rows, "map", STAMP)
    rows["seq"] = 1
    assert from_point_cloud(msg, FORCE)["seq"].tolist() == [0]


def field(msg: PointCloud2, name: str) -> PointField:
    return next(f for f in msg.fields if f.name == name)


def big_endian(msg: PointCloud2) -> None:
    msg.is_bigendian = True


def without_field(msg: PointCloud2) -> None:
    msg.fields = [f for f in msg.fields if f.name != "soil"]


def without_fields(msg: PointCloud2) -> None:
    msg.fields = []


def with_overlapping_field(msg: PointCloud2) -> None:
    msg.fields.append(PointField(name="intensity", offset=0, datatype=7, count=1))


def with_field_twice(msg: PointCloud2) -> None:
    msg.fields.append(PointField(name="soil", offset=26, datatype=PointField.UINT8, count=1))


def field_renamed(msg: PointCloud2) -> None:
    field(msg, "soil").name = "rgb"


def another_datatype(msg: PointCloud2) -> None:
    field(msg, "volume_mm3").datatype = PointField.INT32


def another_offset(msg: PointCloud2) -> None:
    field(msg, "x").offset, field(msg, "y").offset = 4, 0


def count_of_two(msg: PointCloud2) -> None:
    field(msg, "moisture").count = 2


def longer_point(msg: PointCloud2) -> None:
    msg.point_step += 4


def shorter_point(msg: PointCloud2) -> None:
    msg.point_step -= 4


def longer_row(msg: PointCloud2) -> None:
    msg.row_step += 4


def more_points_than_data(msg: PointCloud2) -> None:
    msg.width, msg.row_step = 4, 4 * msg.point_step


def more_rows_than_data(msg: PointCloud2) -> None:
    msg.height = 2


def data_cut_short(msg: PointCloud2) -> None:
    msg.data = array.array("B", bytes(msg.data)[:-1])


def no_data(msg: PointCloud2) -> None:
    msg.data = array.array("B")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (big_endian, ErrorCode.BYTE_ORDER),
        (without_field, ErrorCode.FIELDS),
        (without_fields, ErrorCode.FIELDS),
        (with_overlapping_field, ErrorCode.FIELDS),
        (with_field_twice, ErrorCode.FIELDS),
        (field_renamed, ErrorCode.FIELDS),
        (another_datatype, ErrorCode.FIELDS),
        (another_offset, ErrorCode.FIELDS),
        (count_of_two, ErrorCode.FIELDS),
        (longer_point, ErrorCode.LAYOUT),
        (shorter_point, ErrorCode.LAYOUT),
        (longer_row, ErrorCode.LAYOUT),
        (more_points_than_data, ErrorCode.LAYOUT),
        (more_rows_than_data, ErrorCode.LAYOUT),
        (data_cut_short, ErrorCode.LAYOUT),
        (no_data, ErrorCode.LAYOUT),
    ],
)
def test_malformed_cloud_is_rejected(
    change: Callable[[PointCloud2], None], code: ErrorCode
) -> None:
    msg = to_point_cloud(random_rows(DEPOSIT_REQUEST, 3), "map", STAMP)
    from_point_cloud(msg, DEPOSIT_REQUEST)
    msg = over_the_wire(msg)  # a copy: encoded messages share their list of fields
    change(msg)
    with raises(code, CodecError):
        from_point_cloud(over_the_wire(msg), DEPOSIT_REQUEST)


@pytest.mark.parametrize("dtype", ROW_TYPES.values(), ids=ROW_TYPES)
@pytest.mark.parametrize("count", [0, 5])
def test_fields_appended_by_a_later_version_are_left_out(
    dtype: np.dtype[np.void], count: int
) -> None:
    rows = random_rows(dtype, count)
    later = with_extra_fields(rows, [("new", "<f4"), ("flags", "u1")])
    decoded = from_point_cloud(over_the_wire(to_point_cloud(later, "map", STAMP)), dtype)
    assert decoded.dtype == dtype
    assert decoded.tobytes() == rows.tobytes()
    assert not decoded.flags.writeable


def test_rows_of_another_type_are_rejected() -> None:
    msg = to_point_cloud(random_rows(DEPOSIT_REQUEST, 3), "map", STAMP)
    with raises(ErrorCode.FIELDS, CodecError) as error:
        from_point_cloud(msg, SWEEP)
    assert "lacks the fields [x0, y0, z0" in str(error.value)


@pytest.mark.parametrize(
    "dtype",
    [
        np.dtype("f4"),
        np.dtype([("x", "<i8")]),
        np.dtype([("x", ">f4")]),
        np.dtype([("x", "<f4", (3,))]),
        np.dtype([("a", "u1"), ("b", "<f4")], align=True),
        np.dtype([("b", "<f4"), ("a", "u1")], align=True),
    ],
)
def test_dtype_that_no_point_can_have_is_rejected(dtype: np.dtype[np.void]) -> None:
    with raises(ErrorCode.DTYPE, CodecError):
        to_point_cloud(np.zeros(3, dtype=dtype), "map", STAMP)


@pytest.mark.parametrize("height", [0, 2, 4])
def test_rows_that_do_not_fill_the_cloud_are_rejected(height: int) -> None:
    with raises(ErrorCode.SHAPE, CodecError):
        to_point_cloud(empty_rows(FORCE, 3), "map", STAMP, height=height)


def test_codec_error_is_an_error_of_the_exchange() -> None:
    assert issubclass(CodecError, ExchangeError)

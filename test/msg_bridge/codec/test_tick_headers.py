"""Headers cross exactly, say what each number is, and are refused if they are none."""

import array
import json
from collections.abc import Callable
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Int64MultiArray, MultiArrayDimension, String

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.tick_headers import (
    ArrayKind,
    ArrayMessage,
    from_join_rejected_string,
    from_multi_array,
    to_join_rejected_string,
    to_multi_array,
)
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    JoinRejected,
    MachineHeader,
    MachineReceipt,
    RetransmitRequest,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)

INT64 = st.one_of(st.sampled_from([-(2**63), -1, 0, 2**53 + 1, 2**63 - 1])) | st.integers(
    -(2**63), 2**63 - 1
)
RANGES = st.builds(RowRange, INT64, INT64)
RECEIPTS = st.builds(MachineReceipt, *[INT64] * 5)
MACHINE_HEADERS = st.builds(
    MachineHeader, *[INT64] * 4, st.sampled_from(Verb), RANGES, RANGES, *[INT64] * 5
)
SOIL_HEADERS = st.builds(
    SoilHeader,
    *[INT64] * 3,
    *[RANGES] * 3,
    st.lists(RECEIPTS, max_size=4).map(tuple),
)
RETRANSMIT_REQUESTS = st.builds(
    RetransmitRequest, *[INT64] * 3, st.sampled_from(Stream), INT64, INT64
)
LEDGERS = st.builds(Ledger, *[INT64] * 8).filter(lambda x: -(2**63) <= x.imbalance < 2**63)

RETRANSMIT_REQUEST = RetransmitRequest(1, 2, 7, Stream.DEPOSIT_REQUEST, 120, 40)
SOIL_HEADER = SoilHeader(
    1,
    5,
    9,
    RowRange(11, 2),
    RowRange(21, 3),
    RowRange(31, 4),
    (MachineReceipt(2, 7, 41, 42, 43, 44),),
)


def over_the_wire(msg: Int64MultiArray) -> Int64MultiArray:
    return deserialize_message(serialize_message(msg), Int64MultiArray)


@given(MACHINE_HEADERS | SOIL_HEADERS | RETRANSMIT_REQUESTS | LEDGERS)
def test_every_int64_crosses(message: ArrayMessage) -> None:
    back = from_multi_array(over_the_wire(to_multi_array(message)))
    assert back == message
    assert type(back) is type(message)


def test_enums_come_back_as_enums() -> None:
    back = from_multi_array(to_multi_array(RETRANSMIT_REQUEST))
    assert isinstance(back, RetransmitRequest)
    assert back.stream is Stream.DEPOSIT_REQUEST


def test_soil_header_without_a_machine_crosses() -> None:
    header = SoilHeader(1, 0, 0, RowRange(), RowRange(), RowRange(), ())
    assert from_multi_array(to_multi_array(header)) == header


def read(msg: Int64MultiArray) -> dict[str, int]:
    """What a stranger makes of a message: names and numbers."""
    (dim,) = msg.layout.dim
    return dict(zip(dim.label.split(","), msg.data, strict=True))


def test_layout_is_of_one_dimension() -> None:
    layout = to_multi_array(RETRANSMIT_REQUEST).layout
    assert [(dim.size, dim.stride) for dim in layout.dim] == [(7, 7)]
    assert layout.data_offset == 0


def test_labels_tell_what_each_number_of_a_soil_header_is() -> None:
    assert read(over_the_wire(to_multi_array(SOIL_HEADER))) == {
        "kind": ArrayKind.SOIL_HEADER,
        "run_id": 1,
        "tick": 5,
        "revision": 9,
        "conversions.first": 11,
        "conversions.count": 2,
        "map_updates.first": 21,
        "map_updates.count": 3,
        "forces.first": 31,
        "forces.count": 4,
        "receipts.0.machine_id": 2,
        "receipts.0.session_id": 7,
        "receipts.0.deposit_requests_received": 41,
        "receipts.0.deposit_requests_durable": 42,
        "receipts.0.backlog": 43,
        "receipts.0.tick": 44,
    }


def test_labels_tell_what_each_number_of_a_machine_header_is() -> None:
    header = MachineHeader(1, 2, 3, 4, Verb.STEP, RowRange(5, 6), RowRange(7, 8), 9, 10, 11, 12, 3)
    assert read(to_multi_array(header)) == {
        "kind": ArrayKind.MACHINE_HEADER,
        "run_id": 1,
        "machine_id": 2,
        "session_id": 3,
        "tick": 4,
        "verb": Verb.STEP,
        "sweeps.first": 5,
        "sweeps.count": 6,
        "deposit_requests.first": 7,
        "deposit_requests.count": 8,
        "conversions_received": 9,
        "conversions_durable": 10,
        "pending_mm3": 11,
        "particles_mm3": 12,
        "previous_tick": 3,
    }


def test_ledger_shows_its_imbalance() -> None:
    seen = read(to_multi_array(Ledger(1, 10, 20, 30, 40, 50, 60, 211)))
    assert list(seen)[1:] == [*(f.name for f in fields(Ledger)), "imbalance"]
    assert seen["imbalance"] == -1


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (1, MachineHeader(1, 1, 1, 1, Verb.JOIN)),
        (2, SOIL_HEADER),
        (3, RETRANSMIT_REQUEST),
        (4, Ledger(*[0] * 8)),
    ],
)
def test_kinds_in_bags_keep_their_numbers(kind: int, message: ArrayMessage) -> None:
    assert to_multi_array(message).data[0] == kind


def with_data(msg: Int64MultiArray, data: list[int], label: str | None = None) -> None:
    """Other values in a layout that fits their number."""
    msg.data = array.array("q", data)
    dim = msg.layout.dim[0]
    dim.size = dim.stride = len(data)
    dim.label = dim.label if label is None else label


def no_values(msg: Int64MultiArray) -> None:
    with_data(msg, [])


def unknown_kind(msg: Int64MultiArray) -> None:
    with_data(msg, [99, *msg.data[1:]])


def another_kind(msg: Int64MultiArray) -> None:
    with_data(msg, [ArrayKind.MACHINE_HEADER, *msg.data[1:]])


def value_too_few(msg: Int64MultiArray) -> None:
    with_data(msg, list(msg.data[:-1]))


def value_too_many(msg: Int64MultiArray) -> None:
    with_data(msg, [*msg.data, 0])


def unknown_stream(msg: Int64MultiArray) -> None:
    with_data(msg, [*msg.data[:4], 77, *msg.data[5:]])


def labels_in_another_order(msg: Int64MultiArray) -> None:
    with_data(msg, list(msg.data), "kind,machine_id,run_id,session_id,stream,first,count")


def no_label(msg: Int64MultiArray) -> None:
    with_data(msg, list(msg.data), "")


def no_dimension(msg: Int64MultiArray) -> None:
    msg.layout.dim = []


def two_dimensions(msg: Int64MultiArray) -> None:
    msg.layout.dim.append(MultiArrayDimension(label="more", size=1, stride=1))


def wrong_size(msg: Int64MultiArray) -> None:
    msg.layout.dim[0].size = 6


def wrong_stride(msg: Int64MultiArray) -> None:
    msg.layout.dim[0].stride = 1


def offset(msg: Int64MultiArray) -> None:
    msg.layout.data_offset = 1


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (no_values, r"begins with \[\]"),
        (unknown_kind, r"begins with \[99\]; kinds are 1 MACHINE_HEADER, "),
        (another_kind, "no MACHINE_HEADER: 120 is not a valid Verb"),
        (value_too_few, "too few for a RETRANSMIT_REQUEST"),
        (value_too_many, "a RETRANSMIT_REQUEST has 7 values"),
        (unknown_stream, "no RETRANSMIT_REQUEST: 77 is not a valid Stream"),
        (labels_in_another_order, "labelled 'kind,machine_id,run_id"),
        (no_label, "labelled ''"),
        (no_dimension, "no dimension"),
        (two_dimensions, "one dimension"),
        (wrong_size, "one dimension of that size"),
        (wrong_stride, "one dimension of that size and stride"),
        (offset, "offset 1"),
    ],
)
def test_malformed_array_is_refused(
    spoil: Callable[[Int64MultiArray], None], sentence: str
) -> None:
    msg = to_multi_array(RETRANSMIT_REQUEST)
    spoil(msg)
    with pytest.raises(CodecError, match=sentence):
        from_multi_array(over_the_wire(msg))


def test_half_a_receipt_is_refused() -> None:
    msg = to_multi_array(SOIL_HEADER)
    with_data(msg, list(msg.data[:-2]))
    with pytest.raises(CodecError, match="last 4 values are no whole SourceReceipts"):
        from_multi_array(msg)


def test_ledger_that_contradicts_itself_is_refused() -> None:
    msg = to_multi_array(Ledger(1, 10, 20, 30, 40, 50, 60, 211))
    msg.data[-1] = 0
    with pytest.raises(CodecError, match="imbalance of a LEDGER is 0; its other values make -1"):
        from_multi_array(msg)


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, 1.5, None])
def test_value_that_is_no_int64_is_not_sent(value: object) -> None:
    with pytest.raises(
        CodecError, match=r"life of a RETRANSMIT_REQUEST is .*; it must be an int64"
    ):
        to_multi_array(RetransmitRequest(1, 2, value, Stream.DEPOSIT_REQUEST, 1))  # type: ignore[arg-type]


@given(st.builds(JoinRejected, INT64, INT64, INT64, st.text()))
def test_refusal_crosses(refusal: JoinRejected) -> None:
    msg = deserialize_message(serialize_message(to_join_rejected_string(refusal)), String)
    assert from_join_rejected_string(msg) == refusal


def test_refusal_can_be_read_by_anyone() -> None:
    msg = to_join_rejected_string(JoinRejected(1, 2, 3, "join empty"))
    assert json.loads(msg.data) == {
        "run_id": 1,
        "machine_id": 2,
        "session_id": 3,
        "reason": "join empty",
    }


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no",
        "[" * 100_000,
        "[]",
        "null",
        "{}",
        '{"run_id": 1, "machine_id": 2, "session_id": 3}',
        '{"run_id": 1, "machine_id": 2, "session_id": 3, "reason": null}',
        '{"run_id": 1.0, "machine_id": 2, "session_id": 3, "reason": ""}',
        '{"run_id": true, "machine_id": 2, "session_id": 3, "reason": ""}',
        '{"run_id": 1, "machine_id": 2, "session_id": 3, "reason": "", "more": null}',
    ],
)
def test_malformed_refusal_is_refused(text: str) -> None:
    with pytest.raises(CodecError, match="a refusal must be"):
        from_join_rejected_string(String(data=text))

"""Headers, requests, ledgers and rejections are encoded exactly, with a name for each value."""

import array
import json
from collections.abc import Callable
from dataclasses import astuple, fields, replace

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Int64MultiArray, MultiArrayDimension, String
from support.wire import over_the_wire, raises

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.tick_headers import (
    ArrayKind,
    ArrayMessage,
    from_join_rejected_string,
    from_multi_array,
    to_join_rejected_string,
    to_multi_array,
    with_stamp,
)
from msg_bridge.contract.errors import ErrorCode
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
    MachineHeader, *[INT64] * 4, st.sampled_from(Verb), RANGES, RANGES, *[INT64] * 4
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
LEDGERS = st.builds(Ledger, *[INT64] * 11).filter(lambda x: -(2**63) <= x.imbalance < 2**63)
MESSAGES = MACHINE_HEADERS | SOIL_HEADERS | RETRANSMIT_REQUESTS | LEDGERS

LEDGER = Ledger(1, 1, 10, 20, 30, 40, 50, 60, 211)

RETRANSMIT_REQUEST = RetransmitRequest(1, 2, 7, Stream.DEPOSIT_REQUEST, 120, 40)
SOIL_HEADER = SoilHeader(
    1,
    5,
    9,
    RowRange(11, 2, -1),
    RowRange(21, 3, 22),
    RowRange(31, 4, 33),
    (MachineReceipt(2, 7, 41, 43, 44, 45),),
)


@given(MESSAGES)
def test_every_int64_is_transmitted_exactly(message: ArrayMessage) -> None:
    back = from_multi_array(over_the_wire(to_multi_array(message)))
    assert astuple(back) == astuple(message)
    assert type(back) is type(message)


def test_enumeration_members_are_decoded_as_such() -> None:
    back = from_multi_array(to_multi_array(RETRANSMIT_REQUEST))
    assert isinstance(back, RetransmitRequest)
    assert back.stream is Stream.DEPOSIT_REQUEST


def test_soil_header_without_receipts_is_transmitted() -> None:
    header = SoilHeader(1, 0, 0, RowRange(), RowRange(), RowRange(), ())
    assert from_multi_array(to_multi_array(header)) == header


def read(msg: Int64MultiArray) -> dict[str, int]:
    """Return the values of a message by their labels."""
    (dim,) = msg.layout.dim
    return dict(zip(dim.label.split(","), msg.data, strict=True))


def test_array_has_one_dimension() -> None:
    layout = to_multi_array(RETRANSMIT_REQUEST).layout
    assert [(dim.size, dim.stride) for dim in layout.dim] == [(7, 7)]
    assert layout.data_offset == 0


def test_labels_of_a_soil_header() -> None:
    assert read(over_the_wire(to_multi_array(SOIL_HEADER))) == {
        "kind": ArrayKind.SOIL_HEADER,
        "run_id": 1,
        "tick": 5,
        "revision": 9,
        "conversions.first": 11,
        "conversions.count": 2,
        "conversions.digest": -1,
        "map_updates.first": 21,
        "map_updates.count": 3,
        "map_updates.digest": 22,
        "forces.first": 31,
        "forces.count": 4,
        "forces.digest": 33,
        "receipts.0.machine_id": 2,
        "receipts.0.session_id": 7,
        "receipts.0.deposit_requests_received": 41,
        "receipts.0.backlog": 43,
        "receipts.0.tick": 44,
        "receipts.0.backlog_digest": 45,
    }


def test_labels_of_a_machine_header() -> None:
    header = MachineHeader(1, 2, 3, 4, Verb.STEP, RowRange(5, 6), RowRange(7, 8), 9, 11, 12, 3, 2)
    assert read(to_multi_array(header)) == {
        "kind": ArrayKind.MACHINE_HEADER,
        "run_id": 1,
        "machine_id": 2,
        "session_id": 3,
        "tick": 4,
        "verb": Verb.STEP,
        "sweeps.first": 5,
        "sweeps.count": 6,
        "sweeps.digest": 0,
        "deposit_requests.first": 7,
        "deposit_requests.count": 8,
        "deposit_requests.digest": 0,
        "conversions_received": 9,
        "pending_mm3": 11,
        "particles_mm3": 12,
        "previous_tick": 3,
        "answered_tick": 2,
    }


def test_ledger_states_its_imbalance() -> None:
    values = read(to_multi_array(LEDGER))
    assert list(values)[1:] == [*(f.name for f in fields(Ledger)), "imbalance"]
    assert values["imbalance"] == -1


def test_published_ledger_has_the_end_time_of_its_tick() -> None:
    values = read(to_multi_array(with_stamp(LEDGER, Time(sec=12, nanosec=340))))
    assert (values["stamp_sec"], values["stamp_nanosec"]) == (12, 340)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (1, MachineHeader(1, 1, 1, 1, Verb.JOIN)),
        (2, SOIL_HEADER),
        (3, RETRANSMIT_REQUEST),
        (4, Ledger(*[0] * 9)),
    ],
)
def test_kinds_in_bags_keep_their_numbers(kind: int, message: ArrayMessage) -> None:
    assert to_multi_array(message).data[0] == kind


def with_data(msg: Int64MultiArray, data: list[int], label: str | None = None) -> None:
    """Set other values, in a layout of their number."""
    msg.data = array.array("q", data)
    dim = msg.layout.dim[0]
    dim.size = dim.stride = len(data)
    dim.label = dim.label if label is None else label


def with_labels(msg: Int64MultiArray, change: Callable[[list[str]], list[str]]) -> None:
    """Change the labels, and set 7 as the value of each new one."""
    (dim,) = msg.layout.dim
    values = dict(zip(dim.label.split(","), msg.data, strict=True))
    names = change(list(values))
    with_data(msg, [values.get(name, 7) for name in names], ",".join(names))


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


def missing_label(msg: Int64MultiArray) -> None:
    with_labels(msg, lambda names: [*names[:-2], names[-1]])


def swapped_labels(msg: Int64MultiArray) -> None:
    with_labels(msg, lambda names: [names[0], names[2], names[1], *names[3:]])


def unknown_label_among_the_known(msg: Int64MultiArray) -> None:
    with_labels(msg, lambda names: [*names[:3], "new", *names[3:]])


def repeated_label(msg: Int64MultiArray) -> None:
    with_labels(msg, lambda names: [*names, names[-1]])


def no_label(msg: Int64MultiArray) -> None:
    msg.layout.dim[0].label = ""


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
    ("change", "code"),
    [
        (no_values, ErrorCode.LAYOUT),
        (unknown_kind, ErrorCode.MESSAGE_KIND),
        (another_kind, ErrorCode.LABELS),
        (value_too_few, ErrorCode.LAYOUT),
        (value_too_many, ErrorCode.LAYOUT),
        (unknown_stream, ErrorCode.VALUE),
        (missing_label, ErrorCode.LABELS),
        (swapped_labels, ErrorCode.LABELS),
        (unknown_label_among_the_known, ErrorCode.LABELS),
        (repeated_label, ErrorCode.LABELS),
        (no_label, ErrorCode.LAYOUT),
        (no_dimension, ErrorCode.LAYOUT),
        (two_dimensions, ErrorCode.LAYOUT),
        (wrong_size, ErrorCode.LAYOUT),
        (wrong_stride, ErrorCode.LAYOUT),
        (offset, ErrorCode.LAYOUT),
    ],
)
def test_malformed_array_is_rejected(
    change: Callable[[Int64MultiArray], None], code: ErrorCode
) -> None:
    msg = to_multi_array(RETRANSMIT_REQUEST)
    change(msg)
    with raises(code, CodecError):
        from_multi_array(over_the_wire(msg))


@pytest.mark.parametrize("change", [missing_label, swapped_labels, repeated_label])
def test_soil_header_with_a_malformed_receipt_is_rejected(
    change: Callable[[Int64MultiArray], None],
) -> None:
    msg = to_multi_array(SOIL_HEADER)
    change(msg)
    with raises(ErrorCode.LABELS, CodecError):
        from_multi_array(msg)


@given(MESSAGES, st.integers(1, 3))
def test_values_appended_by_a_later_version_are_left_out(message: ArrayMessage, count: int) -> None:
    msg = to_multi_array(message)
    with_labels(msg, lambda names: [*names, *(f"new.{k}" for k in range(count))])
    assert from_multi_array(over_the_wire(msg)) == message


def test_values_appended_to_each_receipt_are_left_out() -> None:
    receipts = tuple(MachineReceipt(n, 7, 41, 43, 44) for n in (2, 3))
    message = replace(SOIL_HEADER, receipts=receipts)
    msg = to_multi_array(message)

    def append(names: list[str]) -> list[str]:
        middle = names.index("receipts.1.machine_id")
        return [*names[:middle], "receipts.0.new", *names[middle:], "receipts.1.new"]

    with_labels(msg, append)
    assert from_multi_array(msg) == message


def test_ledger_that_contradicts_itself_is_rejected() -> None:
    msg = to_multi_array(LEDGER)
    msg.data[-1] = 0
    with raises(ErrorCode.VALUE, CodecError):
        from_multi_array(msg)


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, 1.5, None])
def test_value_that_is_no_int64_is_not_sent(value: object) -> None:
    request = RetransmitRequest(1, 2, value, Stream.DEPOSIT_REQUEST, 1)  # type: ignore[arg-type]
    with raises(ErrorCode.VALUE, CodecError) as error:
        to_multi_array(request)
    assert str(error.value).startswith("session_id of a RETRANSMIT_REQUEST")


@given(st.builds(JoinRejected, INT64, INT64, INT64, st.text()))
def test_rejection_is_transmitted(rejection: JoinRejected) -> None:
    assert from_join_rejected_string(over_the_wire(to_join_rejected_string(rejection))) == rejection


def test_rejection_is_a_json_object() -> None:
    msg = to_join_rejected_string(JoinRejected(1, 2, 3, "join empty"))
    values = {"run_id": 1, "machine_id": 2, "session_id": 3, "reason": "join empty"}
    assert json.loads(msg.data) == values
    later = String(data=json.dumps({**values, "new": [1]}))
    assert from_join_rejected_string(later) == JoinRejected(1, 2, 3, "join empty")


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
    ],
)
def test_malformed_rejection_is_not_decoded(text: str) -> None:
    with raises(ErrorCode.JSON, CodecError):
        from_join_rejected_string(String(data=text))

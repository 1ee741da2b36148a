"""Rows are delivered once and in order, and discarded ones are not kept."""

import pickle
import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.wire import raises

from msg_bridge.checkpoint.state_pickle import dump_state, load_state
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import RowRange, Stream
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from msg_bridge.exchange.row_digest import row_digest
from msg_bridge.exchange.stream_buffers import ReceiveBuffer, SendBuffer


def numbered(count: int) -> np.ndarray:
    rows = empty_rows(DEPOSIT_REQUEST, count)
    rows["particle_id"] = np.arange(100, 100 + count)
    return SendBuffer(Stream.DEPOSIT_REQUEST).append(rows).rows


@settings(deadline=None, max_examples=50)
@given(st.permutations(range(30)), st.integers(1, 7))
def test_rows_received_in_any_order_are_delivered_once_and_in_order(
    order: list[int], size: int
) -> None:
    rows = numbered(30)
    incoming = ReceiveBuffer(Stream.DEPOSIT_REQUEST)
    num_new = 0
    for k in range(0, 30, size):
        chunk = rows[np.array(order[k : k + size])]
        num_new += incoming.add(chunk)
        incoming.add(chunk)
    assert num_new == 30
    assert np.array_equal(incoming.rows(RowRange(1, 30)), rows)


def test_gaps_are_listed() -> None:
    rows = numbered(10)
    incoming = ReceiveBuffer(Stream.DEPOSIT_REQUEST)
    incoming.add(rows[[0, 1, 4, 8]])
    assert incoming.received == 2
    gaps = incoming.missing(RowRange(1, 10))
    assert gaps == [RowRange(3, 2), RowRange(6, 3), RowRange(10, 1)]
    with raises(ErrorCode.MISSING_ROWS):
        incoming.rows(RowRange(1, 10))


def test_discarded_rows_count_as_duplicates() -> None:
    rows = numbered(10)
    incoming = ReceiveBuffer(Stream.DEPOSIT_REQUEST)
    incoming.add(rows)
    incoming.discard_through(6)
    assert incoming.add(rows) == 0
    assert np.array_equal(incoming.rows(RowRange(7, 4)), rows[6:])


def test_rows_are_kept_until_discarded() -> None:
    outgoing = SendBuffer(Stream.DEPOSIT_REQUEST)
    outgoing.append(empty_rows(DEPOSIT_REQUEST, 5))
    rows, span, *_ = outgoing.append(empty_rows(DEPOSIT_REQUEST, 5))
    assert span == RowRange(6, 5)
    assert rows["seq"].tolist() == [6, 7, 8, 9, 10]
    assert outgoing.kept_rows(RowRange(4, 3))["seq"].tolist() == [4, 5, 6]
    outgoing.discard_through(5)
    assert outgoing.kept_rows(RowRange(4, 3))["seq"].tolist() == [6]


def test_number_far_ahead_is_rejected() -> None:
    rows = numbered(1)
    rows["seq"] = 2**31
    with raises(ErrorCode.SEQUENCE_NUMBER):
        ReceiveBuffer(Stream.DEPOSIT_REQUEST).add(rows)


def test_rows_of_another_type_are_not_sent() -> None:
    with pytest.raises(ValueError, match="is required"):
        SendBuffer(Stream.DEPOSIT_REQUEST).append(empty_rows(SWEEP, 1))


def test_rows_of_another_machine_are_rejected() -> None:
    rows = numbered(3)
    rows["machine_id"] = (2, 2, 1)
    incoming = ReceiveBuffer(Stream.DEPOSIT_REQUEST, machine_id=2)
    with raises(ErrorCode.SENDER_MISMATCH):
        incoming.add(rows)
    assert incoming.add(rows[:2]) == 2


def test_numbers_continue_beyond_32_bits() -> None:
    first = 2**32 - 5
    outgoing, incoming = (
        SendBuffer(Stream.DEPOSIT_REQUEST, first),
        ReceiveBuffer(Stream.DEPOSIT_REQUEST, first),
    )
    for _ in range(4):
        rows, span, *_ = outgoing.append(empty_rows(DEPOSIT_REQUEST, 3))
        assert incoming.add(rows[::-1]) == 3
        assert incoming.add(rows) == 0
        assert incoming.rows(span).size == 3
        incoming.discard_through(span.last)
    assert incoming.expected == first + 12
    assert rows["seq"].max() < 100


def test_discarded_rows_are_freed() -> None:
    incoming, rows = ReceiveBuffer(Stream.DEPOSIT_REQUEST), numbered(100)
    kept = weakref.ref(rows)
    incoming.add(rows)
    incoming.discard_through(100)
    del rows
    assert kept() is None


def test_rows_of_several_messages_are_joined() -> None:
    rows, incoming = numbered(30), ReceiveBuffer(Stream.DEPOSIT_REQUEST)
    for part in (rows[:10], rows[10:25], rows[25:]):
        incoming.add(part)
    assert np.array_equal(incoming.rows(RowRange(5, 22)), rows[4:26])
    incoming.discard_through(12)
    assert np.array_equal(incoming.rows(RowRange(13, 15)), rows[12:27])
    assert incoming.rows(RowRange(13, 0)).size == 0


def test_discarding_across_a_gap() -> None:
    rows, incoming = numbered(20), ReceiveBuffer(Stream.DEPOSIT_REQUEST)
    incoming.add(rows[[0, 1, 4, 5, 6, 9]])
    incoming.discard_through(5)
    assert (incoming.expected, incoming.received) == (6, 7)
    assert np.array_equal(incoming.rows(RowRange(6, 2)), rows[5:7])
    assert incoming.missing(RowRange(6, 10)) == [RowRange(8, 2), RowRange(11, 5)]
    assert incoming.add(rows[:10]) == 2
    assert np.array_equal(incoming.rows(RowRange(6, 5)), rows[5:10])


def test_kept_rows_are_copies_of_those_given() -> None:
    outgoing, rows = SendBuffer(Stream.DEPOSIT_REQUEST), empty_rows(DEPOSIT_REQUEST, 3)
    sent = outgoing.append(rows).rows
    rows["volume_mm3"] = 7
    assert np.array_equal(outgoing.kept_rows(RowRange(1, 3)), sent)
    assert not sent["volume_mm3"].any()


def test_rows_modified_after_they_were_sent_are_rejected() -> None:
    rows = empty_rows(DEPOSIT_REQUEST, 3)
    incoming, sent = ReceiveBuffer(Stream.DEPOSIT_REQUEST), SendBuffer(Stream.DEPOSIT_REQUEST)
    numbered = sent.append(rows)
    incoming.add(numbered.rows, numbered)
    assert incoming.checked_rows(numbered.span) is numbered.rows
    numbered.rows["volume_mm3"] = 7
    with raises(ErrorCode.ROW_DIGEST):
        incoming.checked_rows(numbered.span)


def test_rows_that_were_sent_in_this_process_need_no_digest() -> None:
    incoming, sent = ReceiveBuffer(Stream.DEPOSIT_REQUEST), SendBuffer(Stream.DEPOSIT_REQUEST)
    batches = [sent.append(empty_rows(DEPOSIT_REQUEST, 3)) for _ in range(2)]
    for batch in batches:  # as a machine, which receives an answer before it discards another
        incoming.add(batch.rows, batch)
    for batch in batches:
        assert incoming.checked_rows(batch.span) is batch.rows
        incoming.discard_through(batch.span.last)
        assert "digest" not in vars(batch.span)


def test_rows_are_checked_where_others_were_sent() -> None:
    numbered = SendBuffer(Stream.DEPOSIT_REQUEST, machine_id=1).append(
        empty_rows(DEPOSIT_REQUEST, 3)
    )
    with raises(ErrorCode.SENDER_MISMATCH):
        ReceiveBuffer(Stream.DEPOSIT_REQUEST, machine_id=2).add(numbered.rows, numbered)
    incoming, forged = ReceiveBuffer(Stream.DEPOSIT_REQUEST, machine_id=1), numbered.rows.copy()
    forged["volume_mm3"] = 7
    assert incoming.add(forged, numbered) == 3
    with raises(ErrorCode.ROW_DIGEST):
        incoming.checked_rows(numbered.span)


@pytest.mark.parametrize("count", [3, 5000])
def test_digest_of_sent_rows_is_that_of_their_memory(count: int) -> None:
    sent = SendBuffer(Stream.DEPOSIT_REQUEST).append(empty_rows(DEPOSIT_REQUEST, count))
    digest = row_digest(sent.rows)
    sent.rows["volume_mm3"] = 7
    assert sent.span.digest == digest != row_digest(sent.rows)
    assert sent.span == RowRange(1, count) == replace(sent.span, digest=0)


def test_saved_range_has_the_digest_and_not_the_rows() -> None:
    rows = empty_rows(DEPOSIT_REQUEST, 300)
    sent, incoming = SendBuffer(Stream.DEPOSIT_REQUEST), ReceiveBuffer(Stream.DEPOSIT_REQUEST)
    numbered = sent.append(rows)
    incoming.add(numbered.rows, numbered)
    assert len(pickle.dumps(numbered.span)) < rows.nbytes / 10
    span, loaded = load_state(dump_state((numbered.span, incoming)))
    assert (span, span.digest) == (numbered.span, numbered.span.digest)
    assert np.array_equal(loaded.checked_rows(span), numbered.rows)

"""Ticks, rows and the ledger over the direct and a lossy transport."""

from dataclasses import replace

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.map_updates import map_updates_after
from msg_bridge.contract.messages import MachineHeader, RowChunk, RowRange, Stream
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    FORCE,
    MAP_UPDATE,
    SWEEP,
    ConversionKind,
    empty_rows,
)
from msg_bridge.testing import LossyTransport


def test_every_tick_balances_over_the_direct_transport() -> None:
    run = ExchangeDriver(3)
    run.ticks(200)
    assert len(run.soil.ledgers) == 200
    assert run.is_balanced()
    assert run.soil.ledgers[-1].outside > 0
    assert run.soil.ledgers[-1].particles > 0
    assert any(ledger.in_flight for ledger in run.soil.ledgers)


def test_hundred_thousand_rows_over_a_lossy_transport_are_exact() -> None:
    run = ExchangeDriver(2, drop=0.1, duplicate=0.1, delay=0.2)
    for machine in run.machines:
        machine.rows_per_tick = 200
    run.ticks(320)
    transport = run.transport
    assert isinstance(transport, LossyTransport)
    assert transport.dropped > 1000
    assert transport.duplicated > 1000
    applied = [seq for machine in run.machines for seq in machine.applied]
    assert len(applied) + len(run.soil.rows_seen) > 100_000
    assert len(set(applied)) == len(applied)
    assert len(set(run.soil.rows_seen)) == len(run.soil.rows_seen)
    assert run.is_balanced()


def test_lossy_transport_changes_no_result() -> None:
    outcomes = []
    for loss in ({}, {"drop": 0.3, "duplicate": 0.2, "delay": 0.5}):
        run = ExchangeDriver(2, seed=3, **loss)
        run.ticks(60)
        outcomes.append((run.soil.ledgers[:60], run.machines[0].applied[:300]))
    assert outcomes[0] == outcomes[1]


@pytest.mark.parametrize("tamper", ["drop", "double", "alter"])
def test_tick_of_a_machine_that_applied_other_rows_is_rejected(tamper: str) -> None:
    run = ExchangeDriver()
    machine = run.machines[0]
    apply_unchanged = machine.apply

    def apply(conversions: np.ndarray) -> None:
        excavated = np.flatnonzero(conversions["kind"] == ConversionKind.EXCAVATE)
        if excavated.size and tamper_once:
            tamper_once.clear()
            k = excavated[:1]
            if tamper == "drop":
                conversions = np.delete(conversions, k)
            elif tamper == "double":
                conversions = np.concatenate([conversions, conversions[k]])
            else:
                conversions = conversions.copy()
                conversions["volume_mm3"][k] += 1
        apply_unchanged(conversions)

    tamper_once = [True]
    machine.apply = apply  # type: ignore[method-assign]
    with raises(ErrorCode.VOLUME_MISMATCH):
        run.ticks(30)
    assert run.is_balanced()


def test_terrain_that_loses_volume_shows_as_imbalance() -> None:
    run = ExchangeDriver()
    run.ticks(5)
    run.soil.terrain -= 1
    run.ticks(5)
    assert run.soil.ledgers[0].imbalance == 0
    assert run.soil.ledgers[-1].imbalance == -1


def test_nothing_is_in_flight_after_all_rows_are_acknowledged() -> None:
    run = ExchangeDriver(2)
    run.ticks(20)
    for machine in run.machines:
        machine.rows_per_tick = 0
    run.ticks(3)
    assert run.soil.ledgers[-1].in_flight == 0
    assert run.soil.exchange.accounts.in_flight(1) == 0


@pytest.mark.parametrize(
    ("stream", "rows", "code"),
    [
        (Stream.DEPOSIT_REQUEST, empty_rows(SWEEP, 1), ErrorCode.ROW_TYPE),
        (Stream.CONVERSION, empty_rows(CONVERSION, 1), ErrorCode.STREAM_DIRECTION),
        (Stream.DEPOSIT_REQUEST, empty_rows(DEPOSIT_REQUEST, 1), ErrorCode.SENDER_MISMATCH),
    ],
)
def test_invalid_rows_are_rejected_and_change_nothing(
    stream: Stream, rows: np.ndarray, code: ErrorCode
) -> None:
    run = ExchangeDriver()
    run.ticks(3)
    if stream is Stream.DEPOSIT_REQUEST and rows.dtype == SWEEP:
        rows["machine_id"] = 1
    with raises(code):
        run.soil.exchange.receive(RowChunk(1, stream, 1, 1, rows))
    run.ticks(3)
    assert run.is_balanced()


@pytest.mark.parametrize("span", [RowRange(1, 10**10), RowRange(5000, 3), RowRange(1, -4)])
def test_header_with_invalid_row_counts_is_rejected(span: RowRange) -> None:
    run = ExchangeDriver()
    run.machines[0].rows_per_tick = 3
    run.ticks(3)
    messages = run.hold_next_tick(run.machines[0])
    header = messages[-1]
    assert isinstance(header, MachineHeader)
    with raises(ErrorCode.ROW_RANGE):
        run.soil.exchange.receive(replace(header, sweeps=span))
    for message in messages:
        run.soil.exchange.receive(message)
    run.ticks(3)
    assert run.is_balanced()


def test_conversions_of_a_machine_that_is_not_joined_are_rejected() -> None:
    run = ExchangeDriver()
    run.ticks(3)
    unknown = empty_rows(CONVERSION, 1)
    unknown["machine_id"] = 77
    before = run.soil.exchange.tick
    with raises(ErrorCode.NOT_JOINED):
        run.soil.exchange.answer(
            unknown, empty_rows(FORCE), empty_rows(MAP_UPDATE), revision=1, terrain_mm3=1
        )
    assert run.soil.exchange.tick == before


def test_machine_is_at_most_one_tick_ahead_of_its_answers() -> None:
    run = ExchangeDriver()
    machine = run.machines[0]
    run.until(lambda: machine.exchange.joined)
    while not machine.exchange.waiting:
        machine.step()
    assert machine.exchange.sent_tick == machine.exchange.tick + 2
    with raises(ErrorCode.JOIN_STATE):
        machine.exchange.send(
            empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST), pending_mm3=0, particles_mm3=0
        )


@pytest.mark.parametrize("loss", [{}, {"drop": 0.3, "duplicate": 0.2, "delay": 0.5}])
def test_answers_are_processed_at_a_fixed_delay(loss: dict[str, float]) -> None:
    """Otherwise the input of a machine's tick would depend on the latency of messages."""
    run = ExchangeDriver(2, seed=5, **loss)
    run.ticks(40)
    for machine in run.machines:
        assert len(machine.answers) > 30
        assert {sent - answered for sent, answered in machine.answers} == {1}


def test_send_does_not_modify_its_arguments() -> None:
    run = ExchangeDriver()
    run.until(lambda: run.machines[0].exchange.joined)
    machine = run.machines[0].exchange
    while machine.waiting:
        run.transport.deliver()
        run.soil.step()
        if machine.poll() is not None:
            machine.acknowledge_answer()
    sweeps = empty_rows(SWEEP, 2)
    machine.send(sweeps, empty_rows(DEPOSIT_REQUEST), pending_mm3=0, particles_mm3=0)
    assert not sweeps["machine_id"].any()
    assert not sweeps["seq"].any()


@pytest.mark.parametrize("keyframe", [5, 2**32 - 2])
def test_map_updates_older_than_the_keyframe_are_left_out(keyframe: int) -> None:
    rows = empty_rows(MAP_UPDATE, 4)
    rows["revision"] = (np.arange(-1, 3) + keyframe) % 2**32
    assert np.array_equal(map_updates_after(keyframe, rows), rows[2:])
    assert map_updates_after(keyframe - 2, rows) is rows
    assert map_updates_after(keyframe + 2, rows).size == 0

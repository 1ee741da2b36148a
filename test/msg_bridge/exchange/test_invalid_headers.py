"""Invalid headers are rejected and change nothing; a slow machine shows that it is alive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeSoil
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import (
    MachineHeader,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import DEPOSIT_REQUEST, ConversionKind, Rows, empty_rows
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.row_digest import row_digest


def driver() -> ExchangeDriver:
    """Return a soil and a machine after 5 ticks."""
    run = ExchangeDriver()
    run.ticks(5)
    return run


def next_header(run: ExchangeDriver) -> MachineHeader:
    """Return the header of the machine's next tick, whose rows are delivered."""
    messages = run.hold_next_tick(run.machines[0])
    header = messages.pop()
    for message in messages:
        run.soil.exchange.receive(message)
    assert isinstance(header, MachineHeader)
    return header


@pytest.mark.parametrize("pending", [True, False])
@pytest.mark.parametrize("volume", [-1, 2**53 + 1, 2**63 - 1])
def test_impossible_volume_is_rejected(pending: bool, volume: int) -> None:
    run = driver()
    header = next_header(run)
    invalid = replace(header, **{"pending_mm3" if pending else "particles_mm3": volume})
    with raises(ErrorCode.VOLUME_RANGE):
        run.soil.exchange.receive(invalid)
    run.soil.exchange.receive(header)
    run.ticks(3)
    assert run.is_balanced()


@pytest.mark.parametrize("ahead", [-(2**40), -1, 1, 2**40])
def test_acknowledgement_of_rows_that_cannot_be_applied_yet_is_rejected(ahead: int) -> None:
    run = driver()
    header = next_header(run)
    assert header.conversions_received > 1
    invalid = replace(header, conversions_received=header.conversions_received + ahead)
    with raises(ErrorCode.ACKNOWLEDGEMENT):
        run.soil.exchange.receive(invalid)
    run.soil.exchange.receive(header)
    run.ticks(3)
    assert run.is_balanced()


@pytest.mark.parametrize(
    ("machine_id", "session_id"), [(0, 1), (-1, 1), (65536, 1), (2, 0), (2, -1), (2, 2**32)]
)
def test_join_with_ids_out_of_range_is_rejected(machine_id: int, session_id: int) -> None:
    soil = FakeSoil(np.random.default_rng(0), expected=())
    join = MachineHeader(soil.exchange.run_id, machine_id, session_id, 0, Verb.JOIN)
    with raises(ErrorCode.ID_RANGE):
        soil.exchange.receive(join)
    soil.step()
    assert soil.exchange.joined == ()


def test_slow_machine_requests_the_latest_header() -> None:
    run = driver()
    exchange = run.machines[0].exchange
    while exchange.join_state is not JoinState.READY or run.soil.exchange.tick < exchange.sent_tick:
        run.transport.deliver()
        run.soil.step()
        answer = exchange.poll()
        if answer is not None:
            run.machines[0].apply(answer.conversions)
            exchange.acknowledge_answer()
    run.transport.deliver()
    exchange.request_missing()
    (request,) = exchange.drain_outbox()
    assert isinstance(request, RetransmitRequest)
    assert (request.stream, request.first) == (Stream.HEADER, exchange.sent_tick)
    run.soil.exchange.receive(request)
    (latest,) = run.soil.exchange.drain_outbox()
    assert isinstance(latest, SoilHeader)
    assert latest.tick == exchange.sent_tick
    exchange.receive(latest)
    assert exchange.join_state is JoinState.READY
    run.ticks(3)


def test_reported_volume_that_does_not_follow_from_the_rows_is_rejected() -> None:
    run = driver()
    header = next_header(run)
    with raises(ErrorCode.VOLUME_MISMATCH):
        run.soil.exchange.receive(replace(header, pending_mm3=header.pending_mm3 + 10**15))
    run.soil.exchange.receive(header)
    run.ticks(3)
    assert run.is_balanced()


def too_much(rows: Rows, run: ExchangeDriver) -> None:
    rows["volume_mm3"] = 2**32 - 1


def deposited_particle(rows: Rows, run: ExchangeDriver) -> None:
    """Request a particle whose deposit is published and not acknowledged."""
    answers = run.soil.exchange.accounts.backlog(1)
    rows["particle_id"] = answers["particle_id"][answers["kind"] == ConversionKind.DEPOSIT][0]
    rows["volume_mm3"] = 1


@pytest.mark.parametrize("forge", [too_much, deposited_particle])
def test_deposit_of_soil_that_the_machine_does_not_hold_is_rejected(
    forge: Callable[[Rows, ExchangeDriver], None],
) -> None:
    run = driver()
    soil, machine = run.soil.exchange, run.machines[0]
    while True:
        *chunks, header = run.hold_next_tick(machine)
        answers = soil.accounts.backlog(1)
        if (answers["kind"] == ConversionKind.DEPOSIT).any():
            break
        for message in (*chunks, header):
            soil.receive(message)
    assert isinstance(header, MachineHeader)
    rows = empty_rows(DEPOSIT_REQUEST, 1000)
    rows["seq"] = header.deposit_requests.first + np.arange(rows.size)
    rows["particle_id"], rows["machine_id"] = 10**6 + np.arange(rows.size), 1
    forge(rows, run)
    span = RowRange(header.deposit_requests.first, rows.size, row_digest(rows))
    soil.receive(RowChunk(1, Stream.DEPOSIT_REQUEST, 1, machine.exchange.session_id, rows))
    for message in chunks:
        if isinstance(message, RowChunk) and message.stream is Stream.SWEEP:
            soil.receive(message)
    soil.receive(replace(header, deposit_requests=span))
    with raises(ErrorCode.DEPOSIT_VOLUME):
        soil.poll()
    for message in (*chunks, header):  # those of the machine are accepted afterwards
        soil.receive(message)
    run.ticks(3)
    assert run.is_balanced()

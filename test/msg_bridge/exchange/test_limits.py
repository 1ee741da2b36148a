"""Other runs are ignored, machines cannot run ahead, and memory does not grow with the run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from support.exchange_fakes import GRID, ExchangeDriver, FakeMachine

from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    MachineReceipt,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import SWEEP, empty_rows
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.row_digest import row_digest
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH


def driver(**loss: float) -> ExchangeDriver:
    """Return a soil and a machine after 5 ticks; over a lossy transport if any loss is given."""
    run = ExchangeDriver(**loss)  # type: ignore[arg-type]
    run.ticks(5)
    return run


@pytest.mark.parametrize("run_id", [0, 2])
def test_soil_ignores_messages_of_another_run(run_id: int) -> None:
    run = driver()
    *rows, header = run.hold_next_tick(run.machines[0])
    assert isinstance(header, MachineHeader)
    for message in (*rows, header):
        run.soil.exchange.receive(replace(message, run_id=run_id))  # type: ignore[type-var]
    assert run.soil.exchange.late == (1,), "another run's tick does not complete this one's"
    request = MachineHeader(run_id, 2, 1, -1, Verb.JOIN)
    run.soil.exchange.receive(request)
    for message in (*rows, header):
        run.soil.exchange.receive(message)
    run.ticks(3)
    assert run.soil.exchange.joined == (1,)
    assert run.is_balanced()


@pytest.mark.parametrize("run_id", [0, 2])
def test_machine_ignores_messages_of_another_run(run_id: int) -> None:
    machine = FakeMachine(np.random.default_rng(1)).exchange
    machine.join()
    receipt = MachineReceipt(machine.machine_id, machine.session_id, 0)
    welcome = SoilHeader(1, 0, 0, RowRange(), RowRange(), RowRange(), (receipt,))
    keyframe = Keyframe(1, 0, GRID, np.zeros(GRID.shape))
    for message in (welcome, keyframe):
        machine.receive(replace(message, run_id=run_id))
    assert machine.join_state is JoinState.JOINING
    machine.receive(welcome)
    machine.receive(keyframe)
    assert machine.join_state is JoinState.READY
    dropped = SoilHeader(run_id, 5, 5, RowRange(), RowRange(), RowRange(), ())
    machine.receive(dropped)
    assert machine.join_state is JoinState.READY


def future_headers(run: ExchangeDriver) -> Iterator[MachineHeader]:
    """Yield valid headers of the machine's next ticks, without rows."""
    messages = run.hold_next_tick(run.machines[0])
    header = messages[-1]
    assert isinstance(header, MachineHeader)
    header = replace(
        header,
        sweeps=RowRange(header.sweeps.first),
        deposit_requests=RowRange(header.deposit_requests.first),
    )
    while True:
        yield header
        header = replace(header, tick=header.tick + 1, previous_tick=header.tick)


def test_soil_queues_no_more_headers_than_a_machine_may_be_ahead() -> None:
    run = driver()
    soil, machine = run.soil.exchange, run.machines[0].exchange
    headers = [header for header, _ in zip(future_headers(run), range(20), strict=False)]
    first = headers[0]
    row = empty_rows(SWEEP, 1)
    row["machine_id"], row["seq"] = 1, first.sweeps.first
    missing_row = RowRange(first.sweeps.first, 1, row_digest(row))
    later = [replace(each, sweeps=RowRange(missing_row.last + 1)) for each in headers[1:]]
    soil.receive(replace(first, sweeps=missing_row))
    for header in later:
        run.soil.step(wait=False)  # in real time the soil continues without the machine
        soil.receive(header)
    soil.receive(RowChunk(1, Stream.SWEEP, 1, machine.session_id, row))
    for _ in range(10):
        run.soil.step(wait=False)
    latest = [each for each in soil.drain_outbox() if isinstance(each, SoilHeader)][-1]
    assert latest.receipts[0].tick == first.tick + PIPELINE_DEPTH


def test_soil_ignores_a_header_beyond_the_pipeline() -> None:
    run = driver()
    soil = run.soil.exchange
    first = next(future_headers(run))
    skipped = replace(first, tick=soil.tick + 2 + PIPELINE_DEPTH)  # as after missed ticks
    soil.receive(skipped)
    assert soil.late == (1,)
    soil.receive(first)
    assert soil.late == ()


@pytest.mark.parametrize("loss", [{}, {"drop": 0.2, "duplicate": 0.2, "delay": 0.3}])
def test_memory_does_not_grow_with_the_number_of_ticks(loss: dict[str, float]) -> None:
    run = driver(**loss)
    soil, machine = run.soil.exchange, run.machines[0]
    machine.rows_per_tick = 10
    max_rows_of_tick = 3 + 1 + 2 * 10 + 2 * 10  # map updates, forces, sweeps and deposits, answers
    limit = 2 * (PIPELINE_DEPTH + 3) * max_rows_of_tick
    for _ in range(20):
        run.ticks(10)
        assert soil.num_buffered_rows <= limit
        assert machine.exchange.num_buffered_rows <= limit


def test_machine_discards_deposit_requests_that_the_soil_acknowledges() -> None:
    run = driver()
    machine = run.machines[0]
    run.until(lambda: bool(machine.particles))
    receipts: list[MachineReceipt] = []
    receive = machine.exchange.receive

    def observe(message: object) -> None:
        if isinstance(message, SoilHeader):
            receipts.extend(message.receipts)
        receive(message)  # type: ignore[arg-type]

    machine.exchange.receive = observe  # type: ignore[method-assign, assignment]
    run.ticks(30)
    acknowledged = [receipt.deposit_requests_received for receipt in receipts]
    assert acknowledged == sorted(acknowledged)
    seen = [number for machine_id, number in run.soil.rows_seen if machine_id == 1]
    assert acknowledged[-1] >= seen[len(seen) // 2] > 0  # the latest may not have arrived yet


def test_conversions_are_acknowledged_and_discarded() -> None:
    run = driver()
    header = run.hold_next_tick(run.machines[0])[-1]
    assert isinstance(header, MachineHeader)
    assert header.conversions_received == max(run.machines[0].applied) > 0


def test_rows_of_another_run_are_not_buffered() -> None:
    run = driver()
    before = run.soil.exchange.num_buffered_rows
    rows = empty_rows(SWEEP, 5)
    rows["machine_id"], rows["seq"] = 1, 1000 + np.arange(5)
    session_id = run.machines[0].exchange.session_id
    run.soil.exchange.receive(RowChunk(2, Stream.SWEEP, 1, session_id, rows))
    assert run.soil.exchange.num_buffered_rows == before
    run.soil.exchange.receive(RowChunk(1, Stream.SWEEP, 1, session_id, rows))
    assert run.soil.exchange.num_buffered_rows == before + 5

"""Headers that tell what cannot be are refused and change nothing; a slow machine shows life."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeMachine, FakeSoil

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import MachineHeader, RetransmitRequest, SoilHeader, Stream, Verb
from msg_bridge.exchange.direct_transport import DirectTransport
from msg_bridge.exchange.machine_exchange import JoinState


def driver(seed: int = 0) -> ExchangeDriver:
    soil = FakeSoil(np.random.default_rng(seed))
    machine = FakeMachine(np.random.default_rng(seed + 1))
    run = ExchangeDriver(soil, [machine], DirectTransport(soil.exchange, [machine.exchange]))
    machine.exchange.join()
    run.ticks(5)
    return run


def next_header(run: ExchangeDriver) -> MachineHeader:
    """The header of the machine's next tick, not yet delivered."""
    messages = run.hold_next_tick(run.machines[0])
    header = messages.pop()
    for message in messages:
        run.soil.exchange.receive(message)
    assert isinstance(header, MachineHeader)
    return header


@pytest.mark.parametrize("pending", [True, False])
@pytest.mark.parametrize("held", [-1, 2**53 + 1, 2**63 - 1])
def test_a_volume_that_no_machine_can_hold_is_refused(pending: bool, held: int) -> None:
    run = driver()
    header = next_header(run)
    false = replace(header, pending_mm3=held) if pending else replace(header, particles_mm3=held)
    with pytest.raises(ExchangeError, match="says it holds"):
        run.soil.exchange.receive(false)
    run.soil.exchange.receive(header)
    run.ticks(3)
    assert {ledger.imbalance for ledger in run.soil.ledgers} == {0}


@pytest.mark.parametrize("ahead", [-(2**40), -1, 1, 2**40])
def test_rows_that_it_cannot_have_applied_are_not_believed(ahead: int) -> None:
    run = driver()
    header = next_header(run)
    assert header.conversions_received > 1
    false = replace(header, conversions_received=header.conversions_received + ahead)
    with pytest.raises(ExchangeError, match="has applied conversion row"):
        run.soil.exchange.receive(false)
    run.soil.exchange.receive(header)
    run.ticks(3)
    assert {ledger.imbalance for ledger in run.soil.ledgers} == {0}


@pytest.mark.parametrize(
    ("machine_id", "session_id"), [(0, 1), (-1, 1), (65536, 1), (2, 0), (2, -1), (2, 2**32)]
)
def test_a_join_whose_numbers_fit_no_row_is_refused(machine_id: int, session_id: int) -> None:
    soil = FakeSoil(np.random.default_rng(0), expected=())
    join = MachineHeader(soil.exchange.run_id, machine_id, session_id, 0, Verb.JOIN)
    with pytest.raises(ExchangeError, match="asks to join"):
        soil.exchange.receive(join)
    soil.step()
    assert soil.exchange.joined == ()


def test_one_that_takes_its_time_over_a_tick_shows_life_and_hears_where_the_run_stands() -> None:
    run = driver()
    exchange = run.machines[0].exchange
    while exchange.join_state is not JoinState.READY or run.soil.exchange.tick < exchange.sent_tick:
        run.transport.deliver()
        run.soil.step()
        answer = exchange.poll()
        if answer is not None:
            run.machines[0].apply(answer.conversions)
    run.transport.deliver()
    exchange.request_missing()
    (word,) = exchange.drain_outbox()
    assert isinstance(word, RetransmitRequest)
    assert (word.stream, word.first) == (Stream.HEADER, exchange.sent_tick)
    run.soil.exchange.receive(word)
    (said,) = run.soil.exchange.drain_outbox()
    assert isinstance(said, SoilHeader)
    assert said.tick == exchange.sent_tick
    exchange.receive(said)
    assert exchange.join_state is JoinState.READY
    run.ticks(3)

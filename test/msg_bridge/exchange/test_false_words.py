"""Headers that tell what cannot be are refused and change nothing; a slow machine shows life."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.exchange_parties import BookMachine, BookSoil, Driver

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import MachineHeader, Resend, SoilHeader, Stream, Verb
from msg_bridge.exchange.direct import DirectTransport
from msg_bridge.exchange.machine_side import Phase


def driver(seed: int = 0) -> Driver:
    soil = BookSoil(np.random.default_rng(seed))
    machine = BookMachine(np.random.default_rng(seed + 1))
    run = Driver(soil, [machine], DirectTransport(soil.exchange, [machine.exchange]))
    machine.exchange.join()
    run.ticks(5)
    return run


def next_header(run: Driver) -> MachineHeader:
    """The header of the machine's next tick, not yet delivered."""
    messages = run.held_back(run.machines[0])
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
    ("source", "life"), [(0, 1), (-1, 1), (65536, 1), (2, 0), (2, -1), (2, 2**32)]
)
def test_a_join_whose_numbers_fit_no_row_is_refused(source: int, life: int) -> None:
    soil = BookSoil(np.random.default_rng(0), expected=())
    join = MachineHeader(soil.exchange.epoch, source, life, 0, Verb.JOIN)
    with pytest.raises(ExchangeError, match="asks to join"):
        soil.exchange.receive(join)
    soil.step()
    assert soil.exchange.joined == ()


def test_one_that_takes_its_time_over_a_tick_shows_life_and_hears_where_the_run_stands() -> None:
    run = driver()
    exchange = run.machines[0].exchange
    while exchange.phase is not Phase.READY or run.soil.exchange.tick < exchange.sent_tick:
        run.transport.carry()
        run.soil.step()
        answer = exchange.poll()
        if answer is not None:
            run.machines[0].apply(answer.conversions)
    run.transport.carry()
    exchange.remind()
    (word,) = exchange.take_outbox()
    assert isinstance(word, Resend)
    assert (word.stream, word.first) == (Stream.HEADER, exchange.sent_tick)
    run.soil.exchange.receive(word)
    (said,) = run.soil.exchange.take_outbox()
    assert isinstance(said, SoilHeader)
    assert said.tick == exchange.sent_tick
    exchange.receive(said)
    assert exchange.phase is Phase.READY
    run.ticks(3)

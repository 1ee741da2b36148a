import numpy as np
import pytest
from support.exchange_parties import BookMachine, BookSoil, run

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import MachineHeader, RowChunk, Stream, Verb
from msg_bridge.contract.rows import CONVERSION, LANDED, SWEEP, Kind, empty_rows
from msg_bridge.exchange.direct import DirectTransport
from msg_bridge.testing import LossyTransport


def party(count: int = 1, seed: int = 0) -> tuple[BookSoil, list[BookMachine]]:
    sources = tuple(range(1, count + 1))
    soil = BookSoil(np.random.default_rng(seed), expected=sources)
    machines = [BookMachine(np.random.default_rng(seed + n), n) for n in sources]
    for machine in machines:
        machine.exchange.join()
    return soil, machines


def direct(soil: BookSoil, machines: list[BookMachine]) -> DirectTransport:
    return DirectTransport(soil.exchange, [m.exchange for m in machines])


def test_every_tick_balances_over_the_direct_transport() -> None:
    soil, machines = party(3)
    run(soil, machines, direct(soil, machines), 200)
    assert len(soil.ledgers) == 200
    assert {ledger.imbalance for ledger in soil.ledgers} == {0}
    assert soil.ledgers[-1].outside > 0
    assert soil.ledgers[-1].particles > 0


def test_a_hundred_thousand_rows_through_a_bad_transport_are_exact() -> None:
    soil, machines = party(2)
    for machine in machines:
        machine.rows_per_tick = 200
    transport = LossyTransport(
        soil.exchange, [m.exchange for m in machines], np.random.default_rng(7)
    )
    run(soil, machines, transport, 320)
    assert transport.dropped > 1000
    assert transport.duplicated > 1000
    applied = [seq for machine in machines for seq in machine.applied]
    assert len(applied) + len(soil.rows_seen) > 100_000
    assert len(set(applied)) == len(applied)
    assert len(set(soil.rows_seen)) == len(soil.rows_seen)
    assert {ledger.imbalance for ledger in soil.ledgers} == {0}


def test_a_bad_transport_changes_nothing_but_the_time_it_takes() -> None:
    outcomes = []
    for lossy in (False, True):
        soil, machines = party(2, seed=3)
        ends = [m.exchange for m in machines]
        rng = np.random.default_rng(1)
        transport = LossyTransport(soil.exchange, ends, rng) if lossy else direct(soil, machines)
        run(soil, machines, transport, 60)
        outcomes.append((soil.ledgers[:60], machines[0].applied[:500]))
    assert outcomes[0] == outcomes[1]


@pytest.mark.parametrize("tamper", ["drop", "double", "alter"])
def test_one_bad_row_on_purpose_shows_as_imbalance(tamper: str) -> None:
    soil, machines = party()
    machine = machines[0]
    honest = machine.apply

    def apply(conversions: np.ndarray) -> None:
        excavated = np.flatnonzero(conversions["kind"] == Kind.EXCAVATE)
        if excavated.size and tamper_once:
            tamper_once.clear()
            k = excavated[:1]
            if tamper == "drop":
                conversions = np.delete(conversions, k)
            elif tamper == "double":
                conversions = np.concatenate([conversions, conversions[k]])
            else:
                conversions["volume_mm3"][k] += 1
        honest(conversions)

    tamper_once = [True]
    machine.apply = apply  # type: ignore[method-assign]
    run(soil, machines, direct(soil, machines), 30)
    imbalance = [ledger.imbalance for ledger in soil.ledgers]
    assert imbalance[0] == 0
    assert imbalance[-1] != 0
    if tamper == "alter":
        assert imbalance[-1] == 1


def test_the_first_tick_waits_for_every_expected_machine() -> None:
    soil = BookSoil(np.random.default_rng(0), expected=(1, 2))
    first, second = (BookMachine(np.random.default_rng(n), n) for n in (1, 2))
    transport = direct(soil, [first, second])
    first.exchange.join()
    transport.carry()
    assert soil.exchange.poll() is None
    second.exchange.join()
    transport.carry()
    assert soil.exchange.poll() is not None


def test_a_machine_joins_later_at_a_tick_boundary() -> None:
    soil, machines = party(1)
    late = BookMachine(np.random.default_rng(9), 2)
    transport = direct(soil, [*machines, late])
    run(soil, machines, transport, 10)
    late.exchange.join()
    run(soil, [*machines, late], transport, 20)
    assert soil.exchange.joined == (1, 2)
    assert late.exchange.keyframe is not None
    assert late.applied
    assert {ledger.imbalance for ledger in soil.ledgers} == {0}


def test_what_a_leaving_machine_holds_is_absent_until_it_is_back() -> None:
    soil, machines = party(2)
    transport = LossyTransport(
        soil.exchange, [m.exchange for m in machines], np.random.default_rng(5)
    )
    run(soil, machines, transport, 20)
    stays, goes = machines
    while goes.exchange.waiting:
        transport.carry()
        soil.step()
        soil.exchange.remind()
        goes.exchange.remind()
        stays.step()
        answer = goes.exchange.poll()
        if answer:
            goes.apply(answer.conversions)
    held = sum(goes.totals.values())
    assert held > 0
    goes.exchange.send(empty_rows(SWEEP), empty_rows(LANDED), **goes.totals, leave=True)
    run(soil, [stays], transport, 20)
    assert soil.exchange.joined == (1,)
    assert soil.ledgers[-1].absent == held
    while goes.exchange.waiting:
        goes.exchange.remind()
        transport.carry()
        answer = goes.exchange.poll()
        if answer:
            goes.apply(answer.conversions)
    goes.exchange.join(**goes.totals)
    run(soil, machines, transport, 30)
    assert soil.exchange.joined == (1, 2)
    assert soil.ledgers[-1].absent == 0
    assert {ledger.imbalance for ledger in soil.ledgers} == {0}


def test_a_machine_cannot_join_with_soil_nobody_misses() -> None:
    soil, machines = party(1)
    cheat = BookMachine(np.random.default_rng(9), 2)
    transport = direct(soil, [*machines, cheat])
    cheat.exchange.join(particles_mm3=5)
    run(soil, machines, transport, 5)
    assert soil.exchange.joined == (1,)
    assert "joins with 5 mm^3" in soil.exchange.refused[0]
    assert soil.ledgers[-1].imbalance == 0


def test_messages_of_an_older_epoch_are_ignored() -> None:
    soil, machines = party(1)
    run(soil, machines, direct(soil, machines), 3)
    tick = soil.exchange.tick
    old = MachineHeader(0, 1, tick + 1, Verb.STEP, pending_mm3=12345)
    soil.exchange.receive(old)
    run(soil, machines, direct(soil, machines), 3)
    assert {ledger.imbalance for ledger in soil.ledgers} == {0}


def test_rows_of_the_wrong_kind_are_refused_and_change_nothing() -> None:
    soil, machines = party(1)
    transport = direct(soil, machines)
    run(soil, machines, transport, 3)
    with pytest.raises(ExchangeError, match="1-D array"):
        soil.exchange.receive(RowChunk(1, Stream.LANDED, 1, empty_rows(SWEEP, 1)))
    with pytest.raises(ExchangeError, match="machines send no"):
        soil.exchange.receive(RowChunk(1, Stream.CONVERSION, 1, empty_rows(CONVERSION, 1)))
    run(soil, machines, transport, 3)
    assert soil.ledgers[-1].imbalance == 0


def test_a_machine_must_wait_for_its_answer() -> None:
    soil, machines = party(1)
    run(soil, machines, direct(soil, machines), 2)
    machine = machines[0].exchange
    while not machine.waiting:
        machines[0].step()
    with pytest.raises(ExchangeError, match="last one is answered"):
        machine.send(empty_rows(SWEEP), empty_rows(LANDED), pending_mm3=0, particles_mm3=0)

"""A soil that does not wait: late parts count later, silent machines are absent until back."""

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeMachine, FakeSoil

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from msg_bridge.exchange.direct_transport import DirectTransport
from msg_bridge.exchange.machine_exchange import JoinState
from msg_bridge.testing import LossyTransport


class Clock(ExchangeDriver):
    """Soil and machines, joined, whose soil ticks when told to."""

    def __init__(self, count: int = 1, seed: int = 0, **loss: float) -> None:
        sources = range(1, count + 1)
        soil = FakeSoil(np.random.default_rng(seed), expected=tuple(sources))
        machines = [FakeMachine(np.random.default_rng(seed + n), n) for n in sources]
        ends = [machine.exchange for machine in machines]
        transport = (
            LossyTransport(soil.exchange, ends, np.random.default_rng(seed), **loss)
            if loss
            else DirectTransport(soil.exchange, ends)
        )
        super().__init__(soil, machines, transport)
        for machine in machines:
            machine.exchange.join()
        self.until(lambda: all(m.exchange.joined for m in machines))

    def tick(self) -> Ledger:
        """The clock says so: the soil does not wait."""
        assert self.soil.step(wait=False)
        return self.soil.ledgers[-1]

    def rejoin(self, machine: FakeMachine) -> None:
        machine.exchange.join(**machine.totals)

    def balanced(self) -> bool:
        return {ledger.imbalance for ledger in self.soil.ledgers} == {0}


def test_the_soil_goes_on_without_a_late_machine_and_counts_its_part_later() -> None:
    clock = Clock()
    machine = clock.machines[0]
    clock.ticks(20)
    clock.until(lambda: machine.exchange.waiting)
    seen = len(clock.soil.sweeps_seen)
    before = clock.soil.exchange.tick
    clock.tick()  # its part of this tick is still in its outbox
    clock.tick()
    assert len(clock.soil.sweeps_seen) == seen
    clock.transport.deliver()
    clock.tick()
    assert clock.soil.exchange.tick == before + 3
    numbers = [seq for _, seq in clock.soil.sweeps_seen]
    assert numbers == list(range(1, len(numbers) + 1))
    clock.ticks(20)
    assert clock.balanced()


def test_a_late_machine_is_answered_with_the_rows_of_all_ticks_it_missed() -> None:
    clock = Clock()
    machine = clock.machines[0]
    while not machine.exchange.waiting:  # two ticks are on their way
        machine.step()
    last = machine.exchange.tick
    for _ in range(3):
        clock.tick()
    clock.transport.deliver()
    answers = []
    for _ in range(2):
        clock.tick()
        clock.transport.deliver()
        answers.append(machine.exchange.poll())
        machine.exchange.send(empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST), **machine.totals)
    assert [answer.tick for answer in answers if answer] == [last + 4, last + 5]
    assert [answer.map_updates.size for answer in answers if answer] == [4 * 3, 3]
    assert machine.exchange.sent_tick == last + 6, "numbers follow those of the soil"


def test_an_answer_that_is_lost_for_good_is_made_up_for_by_the_next() -> None:
    clock = Clock()
    machine = clock.machines[0]
    while not machine.exchange.waiting:
        machine.step()
    clock.tick()
    clock.transport.deliver()  # both parts are with the soil
    clock.tick()
    lost = [m for m in clock.soil.exchange.drain_outbox() if isinstance(m, SoilHeader)]
    assert lost[0].receipts[0].tick == machine.exchange.tick + 1
    for _ in range(100):  # so long that it is not kept any more
        clock.tick()
    clock.transport.deliver()
    machine.exchange.request_missing()
    clock.transport.deliver()
    clock.transport.deliver()
    answer = machine.exchange.poll()
    assert answer is not None
    machine.apply(answer.conversions)
    clock.ticks(20)
    assert clock.balanced()


def test_the_receipt_tells_which_tick_of_a_machine_was_taken() -> None:
    clock = Clock()
    clock.until(lambda: clock.machines[0].exchange.waiting)
    first = clock.soil.exchange.tick
    for taken in (first, first, first + 1):
        if taken > first:
            clock.transport.deliver()
        clock.tick()
        headers = [m for m in clock.soil.exchange.drain_outbox() if isinstance(m, SoilHeader)]
        assert [receipt.tick for receipt in headers[-1].receipts] == [taken]


def test_a_dropped_machine_is_absent_and_comes_back_with_all_it_held() -> None:
    clock = Clock(2)
    machine = clock.machines[0]
    clock.ticks(20)
    clock.until(lambda: machine.held > 0 and machine.exchange.waiting)
    held = machine.held
    clock.soil.exchange.drop(1)
    ledger = clock.tick()
    assert ledger.absent != 0
    assert ledger.imbalance == 0
    clock.until(lambda: machine.exchange.join_state is JoinState.OUT)
    assert machine.exchange.dropped
    assert machine.held == held
    clock.rejoin(machine)
    clock.until(lambda: machine.exchange.joined)
    clock.ticks(20)
    assert clock.soil.ledgers[-1].absent == 0
    assert clock.balanced()


def test_with_no_machine_at_all_the_clock_goes_on() -> None:
    clock = Clock()
    clock.leave(clock.machines[0])
    tick = clock.soil.exchange.tick
    clock.tick()
    assert clock.soil.exchange.tick == tick + 1


def test_what_an_absent_machine_held_can_be_released_into_the_terrain() -> None:
    clock = Clock(2)
    machine, other = clock.machines
    clock.ticks(20)
    clock.until(lambda: machine.held > 0)
    clock.leave(machine)
    clock.ticks(2)
    absent = clock.soil.ledgers[-1].absent
    assert absent > 0
    clock.soil.releasing = [1]
    clock.ticks(1)
    assert clock.soil.ledgers[-1].absent == 0
    clock.ticks(5)
    assert clock.balanced()
    clock.rejoin(machine)
    clock.until(lambda: machine.exchange.join_state is JoinState.OUT)
    assert "join empty" in machine.exchange.rejection_reason
    assert other.exchange.joined


def test_a_machine_that_takes_part_cannot_be_released() -> None:
    clock = Clock()
    with pytest.raises(ExchangeError, match="once it has left"):
        clock.soil.exchange.release(1)


def test_released_soil_that_is_not_put_down_is_refused() -> None:
    clock = Clock(2)
    clock.ticks(20)
    clock.until(lambda: clock.machines[0].held > 0)
    clock.leave(clock.machines[0])
    clock.soil.exchange.release(1)
    with pytest.raises(ExchangeError, match="were released"):
        clock.soil.step(wait=False)


def test_one_that_takes_no_part_cannot_be_dropped() -> None:
    clock = Clock()
    clock.soil.exchange.drop(1)
    with pytest.raises(ExchangeError, match="takes no part"):
        clock.soil.exchange.drop(1)


@pytest.mark.parametrize("seed", range(6))
def test_impatience_over_a_bad_transport_loses_nothing(seed: int) -> None:
    clock = Clock(3, seed, drop=0.2, duplicate=0.2, delay=0.4)
    rng = np.random.default_rng(1000 + seed)
    for _ in range(1500):
        clock.round()
        if rng.random() < 0.3:
            clock.tick()
        joined = clock.soil.exchange.joined
        if joined and rng.random() < 0.01:
            clock.soil.exchange.drop(int(rng.choice(joined)))
        for machine in clock.machines:
            if machine.exchange.join_state is JoinState.OUT and rng.random() < 0.1:
                clock.rejoin(machine)
    assert clock.balanced()
    for machine_id in (1, 2, 3):
        numbers = [seq for who, seq in clock.soil.sweeps_seen if who == machine_id]
        assert len(numbers) > 100, "every machine got its part in"

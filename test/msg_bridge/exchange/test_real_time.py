"""A soil that does not wait: late parts belong to later ticks, dropped machines are absent."""

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeMachine
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from msg_bridge.exchange.join_state import JoinState


class Clock(ExchangeDriver):
    """Soil and machines, joined; the soil can tick without waiting."""

    def __init__(self, count: int = 1, seed: int = 0, **loss: float) -> None:
        super().__init__(count, seed=seed, **loss)
        self.until(lambda: all(m.exchange.joined for m in self.machines))

    def tick(self) -> Ledger:
        """Do one tick without waiting for machines."""
        assert self.soil.step(wait=False)
        return self.soil.ledgers[-1]

    def rejoin(self, machine: FakeMachine) -> None:
        machine.exchange.join(**machine.totals)


def test_input_of_a_late_machine_belongs_to_a_later_tick() -> None:
    clock = Clock()
    machine = clock.machines[0]
    clock.ticks(20)
    clock.until(lambda: machine.exchange.waiting)
    num_seen = len(clock.soil.sweeps_seen)
    before = clock.soil.exchange.tick
    clock.tick()  # its part of this tick is still in its outbox
    clock.tick()
    assert len(clock.soil.sweeps_seen) == num_seen
    clock.transport.deliver()
    clock.tick()
    assert clock.soil.exchange.tick == before + 3
    numbers = [seq for _, seq in clock.soil.sweeps_seen]
    assert numbers == list(range(1, len(numbers) + 1))
    clock.ticks(20)
    assert clock.is_balanced()


def test_late_machine_is_answered_with_the_rows_of_all_ticks_it_missed() -> None:
    clock = Clock()
    machine = clock.machines[0]
    while not machine.exchange.waiting:  # two ticks are in flight
        machine.step()
    last = machine.exchange.tick
    for _ in range(3):
        clock.tick()
    clock.transport.deliver()
    answers = []
    for _ in range(2):
        clock.tick()
        clock.transport.deliver()
        answer = machine.exchange.poll()
        assert answer is not None
        answers.append(answer)
        machine.apply(answer.conversions)
        machine.exchange.acknowledge_answer()
        machine.exchange.send(empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST), **machine.totals)
    assert [answer.tick for answer in answers] == [last + 4, last + 5]
    assert [answer.map_updates.size for answer in answers] == [4 * 3, 3]
    assert machine.exchange.sent_tick == last + 6, "its ticks have the numbers of the soil's"


def test_discarded_answer_is_replaced_by_a_later_one() -> None:
    clock = Clock()
    machine = clock.machines[0]
    while not machine.exchange.waiting:
        machine.step()
    clock.tick()
    clock.transport.deliver()  # both parts are with the soil
    clock.tick()
    lost = [m for m in clock.soil.exchange.drain_outbox() if isinstance(m, SoilHeader)]
    assert lost[0].receipts[0].tick == machine.exchange.tick + 1
    for _ in range(100):  # more than the soil keeps
        clock.tick()
    clock.transport.deliver()
    machine.exchange.request_missing()
    clock.transport.deliver()
    clock.transport.deliver()
    answer = machine.exchange.poll()
    assert answer is not None
    machine.apply(answer.conversions)
    machine.exchange.acknowledge_answer()
    clock.ticks(20)
    assert clock.is_balanced()


def test_receipt_has_the_last_processed_tick_of_a_machine() -> None:
    clock = Clock()
    clock.until(lambda: clock.machines[0].exchange.waiting)
    first = clock.soil.exchange.tick
    for processed in (first, first, first + 1):
        if processed > first:
            clock.transport.deliver()
        clock.tick()
        headers = [m for m in clock.soil.exchange.drain_outbox() if isinstance(m, SoilHeader)]
        assert [receipt.tick for receipt in headers[-1].receipts] == [processed]


def test_dropped_machine_rejoins_with_all_its_soil() -> None:
    clock = Clock(2)
    machine = clock.machines[0]
    clock.ticks(20)
    clock.until(lambda: machine.soil_mm3 > 0 and machine.exchange.waiting)
    volume = machine.soil_mm3
    clock.soil.exchange.drop(1)
    ledger = clock.tick()
    assert ledger.absent != 0
    assert ledger.imbalance == 0
    clock.until(lambda: machine.exchange.join_state is JoinState.OUT)
    assert machine.exchange.dropped
    assert machine.soil_mm3 == volume
    clock.rejoin(machine)
    clock.until(lambda: machine.exchange.joined)
    clock.ticks(20)
    assert clock.soil.ledgers[-1].absent == 0
    assert clock.is_balanced()


def test_without_any_machine_the_soil_continues() -> None:
    clock = Clock()
    clock.leave(clock.machines[0])
    tick = clock.soil.exchange.tick
    clock.tick()
    assert clock.soil.exchange.tick == tick + 1


def test_soil_of_an_absent_machine_can_be_released_into_the_terrain() -> None:
    clock = Clock(2)
    machine, other = clock.machines
    clock.ticks(20)
    clock.until(lambda: machine.soil_mm3 > 0)
    clock.leave(machine)
    clock.ticks(2)
    absent = clock.soil.ledgers[-1].absent
    assert absent > 0
    clock.soil.releasing = [1]
    clock.ticks(1)
    assert clock.soil.ledgers[-1].absent == 0
    clock.ticks(5)
    assert clock.is_balanced()
    clock.rejoin(machine)
    clock.until(lambda: machine.exchange.join_state is JoinState.OUT)
    assert machine.exchange.rejection_reason
    assert other.exchange.joined


def test_soil_of_a_joined_machine_cannot_be_released() -> None:
    clock = Clock()
    with raises(ErrorCode.STILL_JOINED):
        clock.soil.exchange.release(1)


def test_released_soil_must_be_deposited() -> None:
    clock = Clock(2)
    clock.ticks(20)
    clock.until(lambda: clock.machines[0].soil_mm3 > 0)
    clock.leave(clock.machines[0])
    clock.soil.exchange.release(1)
    with raises(ErrorCode.RELEASE):
        clock.soil.step(wait=False)


def test_machine_that_is_not_joined_cannot_be_dropped() -> None:
    clock = Clock()
    clock.soil.exchange.drop(1)
    with raises(ErrorCode.NOT_JOINED):
        clock.soil.exchange.drop(1)


@pytest.mark.parametrize("seed", range(6))
def test_real_time_over_a_lossy_transport_loses_nothing(seed: int) -> None:
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
    assert clock.is_balanced()
    for machine_id in (1, 2, 3):
        numbers = [seq for sender, seq in clock.soil.sweeps_seen if sender == machine_id]
        assert len(numbers) > 100, "every machine took part"


def test_soil_that_does_not_wait_requests_the_lost_tick_of_a_late_machine() -> None:
    clock = Clock()
    machine = clock.machines[0]
    clock.hold_next_tick(machine)  # its header and rows are lost
    for _ in range(5):
        clock.tick()
    assert clock.soil.exchange.late == (1,)
    for _ in range(2):  # the header first, then the rows that it counts
        clock.soil.exchange.request_missing()
        clock.transport.deliver()
        clock.transport.deliver()
    assert clock.soil.exchange.late == ()
    clock.ticks(10)
    assert clock.is_balanced()

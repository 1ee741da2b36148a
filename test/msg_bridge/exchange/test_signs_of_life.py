"""Which messages show the soil that a machine is alive."""

from __future__ import annotations

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeMachine

from msg_bridge.contract.messages import MachineHeader, Message, RowChunk, SoilHeader
from msg_bridge.exchange.join_state import JoinState


class Wiretap(ExchangeDriver):
    """A driver that keeps what the first machine sends."""

    def __init__(self) -> None:
        super().__init__(1)
        self.sent: list[Message] = []
        end = self.machines[0].exchange
        drain = end.drain_outbox

        def drain_and_keep() -> list[Message]:
            messages = drain()
            self.sent += messages
            return messages

        end.drain_outbox = drain_and_keep  # type: ignore[method-assign]


def heartbeat(machine: FakeMachine) -> list[Message]:
    """Return what a machine repeats while nothing arrives; what it has sent is lost."""
    machine.exchange.drain_outbox()
    machine.exchange.request_missing()
    return machine.exchange.drain_outbox()


def test_messages_of_ticks_that_are_over_are_no_signs_of_life() -> None:
    run = Wiretap()
    run.ticks(10)
    over = list(run.sent)
    run.ticks(5)
    soil = run.soil.exchange
    assert {type(message) for message in over} > {MachineHeader, RowChunk}
    assert not any(soil.receive(message) for message in over)
    assert any(soil.receive(message) for message in heartbeat(run.machines[0]))


def exchange_ticks(run: ExchangeDriver, last: int, lost: int | None = None) -> None:
    """Let one machine and the soil perform ticks up to a number.

    Args:
        run: the run.
        last: the last tick that the soil answers.
        lost: tick of a header of the soil that is lost.
    """
    (machine,), soil = run.machines, run.soil.exchange
    while soil.tick < last:
        machine.step()
        for message in machine.exchange.drain_outbox():
            soil.receive(message)
        run.soil.step()
        for message in soil.drain_outbox():
            if not isinstance(message, SoilHeader) or message.tick != lost:
                machine.exchange.receive(message)


def test_slow_machine_that_lacks_nothing_shows_that_it_is_alive() -> None:
    run = ExchangeDriver(1)
    exchange_ticks(run, 10)
    (machine,) = run.machines
    assert machine.exchange.poll() is not None
    machine.exchange.acknowledge_answer()
    (request,) = heartbeat(machine)
    assert run.soil.exchange.receive(request)


def test_machine_that_lacks_the_answer_before_the_last_shows_that_it_is_alive() -> None:
    run = ExchangeDriver(1)
    exchange_ticks(run, 10)
    exchange_ticks(run, 12, lost=11)
    header, request = heartbeat(run.machines[0])
    assert isinstance(header, MachineHeader)
    assert header.tick == 11
    assert run.soil.exchange.receive(header)
    assert run.soil.exchange.receive(request)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("is_real_time", [False, True])
def test_heartbeat_of_a_machine_that_the_soil_waits_for_is_a_sign_of_life(
    seed: int, is_real_time: bool
) -> None:
    run = ExchangeDriver(3, seed=seed, drop=0.3, duplicate=0.2, delay=0.6)
    soil, rng = run.soil.exchange, np.random.default_rng(seed)
    num_checked = 0
    for _ in range(2000):
        run.round()
        if is_real_time and rng.random() < 0.1:
            run.soil.step(wait=False)
        for machine in run.machines:
            end, draw = machine.exchange, rng.random()
            if end.join_state is JoinState.OUT:
                end.join(**machine.totals)
            elif end.machine_id in soil.late and is_real_time and draw < 0.01:
                soil.drop(end.machine_id)
            elif end.machine_id in soil.late and draw < 0.2:
                messages = heartbeat(machine)
                assert [message for message in messages if soil.receive(message)]
                num_checked += 1
    assert num_checked > 200
    assert soil.tick > 100
    assert run.is_balanced()

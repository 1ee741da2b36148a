"""Requests of other publishers to join as a machine, without an exchange key."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeMachine

from msg_bridge.contract.messages import MachineHeader, Verb
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_account import signed_volume
from msg_bridge.exchange.soil_exchange import SoilExchange

FORGED = 77
"""Session of a forged request."""


def forged_join(soil: SoilExchange, session_id: int = FORGED) -> MachineHeader:
    """Return a request to join as machine 2."""
    return MachineHeader(soil.run_id, 2, session_id, -1, Verb.JOIN)


def forged_rejoin(soil: SoilExchange) -> MachineHeader:
    """Return a request to rejoin with the soil of machine 2, as if all its rows were applied."""
    backlog = soil.accounts.backlog(2)
    assert signed_volume(backlog) != 0
    ledger = soil.ledger
    assert ledger is not None
    return MachineHeader(
        soil.run_id,
        2,
        FORGED,
        -1,
        Verb.REJOIN,
        conversions_received=int(backlog["seq"][-1]),
        pending_mm3=ledger.absent + signed_volume(backlog),
    )


def with_absent_machine() -> tuple[ExchangeDriver, FakeMachine]:
    """Return a run of two machines, of which the second has left with soil."""
    fleet = ExchangeDriver(2, expected=2)
    fleet.ticks(10)
    machine = fleet.machines[1]
    fleet.leave(machine)
    assert machine.soil_mm3 > 0
    return fleet, machine


def return_to_run(fleet: ExchangeDriver, machine: FakeMachine) -> None:
    """Let a machine rejoin with its soil while another session takes part, which is dropped."""
    soil = fleet.soil.exchange
    fleet.until(lambda: soil.joined == (1, 2))
    machine.exchange.join(**machine.totals)
    fleet.until(lambda: 2 in soil.contending_requests)
    soil.drop(2)
    fleet.until(lambda: machine.exchange.joined or bool(machine.exchange.rejection_reason))


def test_request_during_a_session_has_no_effect_unless_it_is_repeated() -> None:
    fleet = ExchangeDriver(2, expected=2)
    fleet.ticks(5)
    soil = fleet.soil.exchange
    machine = fleet.machines[1]
    session_id = machine.exchange.session_id
    for forged in (1, FORGED, 2**32 - 1):  # smaller or larger does not matter
        soil.receive(forged_join(soil, forged))
    assert 2 in soil.contending_requests
    fleet.ticks(20)
    assert soil.joined == (1, 2)
    assert fleet.soil.ledgers[-1].absent == 0
    assert machine.exchange.session_id == session_id
    fleet.leave(machine)
    fleet.ticks(5)
    assert soil.joined == (1,)
    soil.receive(forged_join(soil))
    fleet.until(lambda: soil.joined == (1, 2))
    assert fleet.is_balanced()


@pytest.mark.parametrize("forge", [forged_join, forged_rejoin])
def test_machine_whose_place_was_taken_returns_with_its_soil(
    forge: Callable[[SoilExchange], MachineHeader],
) -> None:
    fleet, machine = with_absent_machine()
    fleet.soil.exchange.receive(forge(fleet.soil.exchange))
    return_to_run(fleet, machine)
    assert machine.exchange.rejection_reason == ""
    fleet.ticks(20)
    ledger = fleet.soil.ledgers[-1]
    assert fleet.soil.exchange.joined == (1, 2)
    assert (ledger.absent, ledger.imbalance) == (0, 0)
    assert fleet.is_balanced()


def test_empty_machine_whose_place_was_taken_returns() -> None:
    fleet = ExchangeDriver(2, expected=2)
    machine = fleet.machines[1]
    machine.rows_per_tick = 0
    fleet.ticks(5)
    fleet.leave(machine)
    assert machine.soil_mm3 == 0
    soil = fleet.soil.exchange
    soil.receive(forged_join(soil))
    return_to_run(fleet, machine)
    assert machine.exchange.rejection_reason == ""
    machine.rows_per_tick = 8
    fleet.ticks(20)
    assert soil.joined == (1, 2)
    assert fleet.is_balanced()


def test_machine_returns_with_its_soil_after_ticks_of_another_session() -> None:
    fleet, machine = with_absent_machine()
    soil = fleet.soil.exchange
    other = FakeMachine(np.random.default_rng(5), 2, session_id=FORGED)
    fleet.machines[1] = other
    fleet.connect()
    other.exchange.join()
    fleet.until(lambda: other.soil_mm3 > 0)
    fleet.leave(other)
    dug = other.soil_mm3 + signed_volume(soil.accounts.backlog(2))
    fleet.machines[1] = machine
    fleet.connect()
    machine.exchange.join(**machine.totals)
    fleet.until(lambda: machine.exchange.joined)
    fleet.ticks(20)
    # What the other session dug remains absent, as what a crashed process held.
    assert fleet.soil.ledgers[-1].absent == dug > 0
    assert fleet.is_balanced()


def test_machine_cannot_rejoin_with_released_soil() -> None:
    fleet, machine = with_absent_machine()
    soil = fleet.soil.exchange
    soil.receive(forged_join(soil))
    fleet.until(lambda: soil.joined == (1, 2))
    soil.drop(2)
    fleet.soil.releasing = [2]
    fleet.ticks(1)
    assert fleet.soil.ledgers[-1].absent == 0
    machine.exchange.join(**machine.totals)
    fleet.until(lambda: machine.exchange.join_state is JoinState.OUT)
    assert "left with that soil" in machine.exchange.rejection_reason
    assert fleet.is_balanced()

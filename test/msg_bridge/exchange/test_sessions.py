"""Machines that join late, leave, rejoin, crash and restart."""

import numpy as np
import pytest
from support.exchange_fakes import GRID, ExchangeDriver, FakeMachine
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    MachineHeader,
    RowChunk,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.welcome import Welcome

GOOD: dict[str, float] = {}
BAD = {"drop": 0.2, "duplicate": 0.2, "delay": 0.4}


class Fleet(ExchangeDriver):
    """A driver that can stop sending."""

    def until_ready(self, machine: FakeMachine) -> None:
        """Wait for the answer to a machine's tick without sending another."""
        for _ in range(100):
            self.transport.deliver()
            self.soil.step()
            if machine.exchange.join_state is JoinState.READY:
                return
            answer = machine.exchange.poll()
            if answer is not None:
                machine.apply(answer.conversions)
                machine.exchange.acknowledge_answer()
        raise AssertionError("no answer")


def test_first_tick_waits_for_every_expected_machine() -> None:
    fleet = Fleet(2, expected=2)
    first, second = fleet.machines
    second.exchange = MachineExchange(2)
    fleet.connect()
    fleet.transport.deliver()
    assert fleet.soil.exchange.poll() is None
    second.exchange.join()
    fleet.transport.deliver()
    assert fleet.soil.exchange.poll() is not None
    assert not first.exchange.joined


@pytest.mark.parametrize("loss", [GOOD, BAD])
def test_machine_joins_later_at_a_tick_boundary(loss: dict[str, float]) -> None:
    fleet = Fleet(2, expected=1, **loss)
    fleet.ticks(10)
    late = fleet.machines[1]
    late.exchange.join()
    fleet.until(lambda: len(late.applied) > 20)
    assert fleet.soil.exchange.joined == (1, 2)
    assert late.exchange.keyframe is not None
    assert fleet.is_balanced()


@pytest.mark.parametrize("loss", [GOOD, BAD])
def test_soil_of_a_leaving_machine_is_absent_until_it_rejoins(loss: dict[str, float]) -> None:
    fleet = Fleet(2, expected=2, **loss)
    fleet.ticks(20)
    leaving = fleet.machines[1]
    fleet.leave(leaving)
    assert leaving.soil_mm3 > 0
    fleet.ticks(20)
    assert fleet.soil.exchange.joined == (1,)
    assert fleet.soil.ledgers[-1].absent == leaving.soil_mm3
    before = len(leaving.applied)
    leaving.exchange.join(**leaving.totals)
    fleet.until(lambda: len(leaving.applied) > before + 30)
    assert fleet.soil.ledgers[-1].absent == 0
    assert fleet.is_balanced()


def test_rows_of_the_last_tick_are_received_after_rejoining() -> None:
    fleet = Fleet(1, expected=1)
    machine = fleet.machines[0]
    machine.rows_per_tick = 0
    fleet.ticks(3)
    assert machine.soil_mm3 == 0
    fleet.until_ready(machine)
    machine.exchange.send(
        empty_rows(SWEEP, 3), empty_rows(DEPOSIT_REQUEST), **machine.totals, leave=True
    )
    fleet.leave(machine)
    assert machine.soil_mm3 == 0
    machine.exchange.join()
    fleet.ticks(3)
    assert machine.soil_mm3 == fleet.soil.ledgers[0].terrain - fleet.soil.terrain
    assert fleet.is_balanced()


def test_two_machines_leave_in_successive_ticks() -> None:
    fleet = Fleet(3, expected=3)
    fleet.ticks(10)
    fleet.leave(fleet.machines[0])
    fleet.leave(fleet.machines[1])
    fleet.leave(fleet.machines[2])
    assert fleet.soil.exchange.joined == ()
    assert fleet.is_balanced()
    fleet.machines[0].exchange.join(**fleet.machines[0].totals)
    fleet.ticks(5)
    assert fleet.is_balanced()


def test_crashed_machine_restarts_empty_and_its_soil_remains_absent() -> None:
    fleet = Fleet(2, expected=2, **BAD)
    fleet.ticks(15)
    volume = fleet.machines[1].soil_mm3
    assert volume > 0
    fleet.machines[1] = FakeMachine(np.random.default_rng(99), 2, session_id=10)
    fleet.connect()
    fleet.machines[1].exchange.join()
    fleet.until(lambda: 2 in fleet.soil.exchange.contending_requests)
    fleet.soil.exchange.drop(2)
    fleet.ticks(20)
    assert fleet.soil.exchange.joined == (1, 2)
    lost = fleet.soil.ledgers[-1].absent
    assert lost > 0
    assert fleet.is_balanced()
    # It can leave and rejoin in its new session like any other.
    fleet.leave(fleet.machines[1])
    fleet.ticks(3)
    fleet.machines[1].exchange.join(**fleet.machines[1].totals)
    fleet.ticks(10)
    assert fleet.soil.exchange.joined == (1, 2)
    assert fleet.soil.ledgers[-1].absent == lost
    assert fleet.is_balanced()


def test_rejoining_with_another_volume_is_rejected() -> None:
    fleet = Fleet(2, expected=2)
    fleet.ticks(10)
    machine = fleet.machines[1]
    fleet.leave(machine)
    machine.exchange.join(pending_mm3=machine.totals["pending_mm3"] + 5, particles_mm3=0)
    fleet.ticks(5)
    assert fleet.soil.exchange.joined == (1,)
    assert machine.exchange.join_state is JoinState.OUT
    assert "left with that soil" in machine.exchange.rejection_reason
    assert fleet.is_balanced()


def test_joining_twice_is_an_error() -> None:
    fleet = Fleet(1, expected=1)
    fleet.ticks(2)
    with raises(ErrorCode.JOIN_STATE):
        fleet.machines[0].exchange.join()


def test_duplicate_of_an_old_join_request_changes_nothing() -> None:
    fleet = Fleet(2, expected=2)
    machine = fleet.machines[1].exchange
    fleet.ticks(5)
    fleet.leave(fleet.machines[1])
    old_request = MachineHeader(machine.run_id, 2, machine.session_id, -1, Verb.JOIN)
    fleet.soil.exchange.receive(old_request)
    fleet.ticks(5)
    assert fleet.soil.exchange.joined == (1,)
    assert fleet.is_balanced()


def test_rows_of_an_earlier_session_are_ignored() -> None:
    fleet = Fleet(2, expected=2)
    fleet.ticks(5)
    machine = fleet.machines[1]
    fleet.leave(machine)
    machine.rows_per_tick = 0
    seen = len(fleet.soil.sweeps_seen)
    machine.exchange.join(**machine.totals)
    fleet.until(lambda: machine.exchange.joined)
    stale = empty_rows(SWEEP, 5)
    stale["machine_id"], stale["seq"] = 2, np.arange(1, 6)
    fleet.soil.exchange.receive(
        RowChunk(1, Stream.SWEEP, 2, machine.exchange.session_id - 1, stale)
    )
    machine.rows_per_tick = 8
    fleet.ticks(5)
    own = [seq for machine_id, seq in fleet.soil.sweeps_seen[seen:] if machine_id == 2]
    assert own == list(range(1, len(own) + 1))
    assert fleet.is_balanced()


def test_keyframe_for_another_machine_hides_no_update() -> None:
    fleet = Fleet(1, expected=1)
    fleet.ticks(3)
    machine = fleet.machines[0].exchange
    fleet.until_ready(fleet.machines[0])
    tick = machine.tick
    machine.send(empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST), **fleet.machines[0].totals)
    newest = Keyframe(1, 10_000, GRID, np.zeros((4, 4)))
    machine.receive(newest)
    fleet.transport.deliver()
    fleet.soil.step()
    fleet.transport.deliver()
    answer = machine.poll()
    assert answer is not None
    assert answer.tick == tick + 1
    assert answer.map_updates.size == 3


def test_machine_joins_with_a_terrain_not_older_than_the_welcome() -> None:
    fleet = Fleet(2, expected=1)
    fleet.ticks(10)
    late = fleet.machines[1].exchange
    late.join()
    late.receive(Keyframe(1, 2, GRID, np.zeros((4, 4))))
    fleet.until(lambda: late.joined)
    assert late.keyframe is not None
    assert late.keyframe.revision >= late.tick


def test_machine_that_is_out_buffers_nothing() -> None:
    fleet = Fleet(2, expected=1)
    fleet.ticks(50)
    machine = fleet.machines[1].exchange
    machine.join()
    assert machine.drain_outbox()  # its request only
    assert machine.num_buffered_rows == 0


@pytest.mark.parametrize("seed", range(6))
def test_random_joins_and_leaves_over_a_lossy_transport_lose_nothing(seed: int) -> None:
    fleet = Fleet(3, expected=3, seed=seed, drop=0.3, duplicate=0.2, delay=0.6)
    rng = np.random.default_rng(100 + seed)
    for _ in range(12):
        fleet.ticks(int(rng.integers(1, 6)))
        machine = fleet.machines[int(rng.integers(1, 3))]
        draw = rng.random()
        if machine.exchange.join_state is JoinState.OUT:
            machine.exchange.join(**machine.totals)
        elif draw < 0.6 and machine.exchange.joined:
            fleet.leave(machine)
        elif draw < 0.8:
            k = fleet.machines.index(machine)
            session_id = machine.exchange.session_id
            fleet.machines[k] = FakeMachine(rng, machine.exchange.machine_id, session_id=session_id)
            fleet.connect()
            fleet.machines[k].exchange.join()
            restarted = machine.exchange.machine_id
            fleet.until(lambda n=restarted: n in fleet.soil.exchange.contending_requests)  # type: ignore[misc]
            fleet.soil.exchange.drop(restarted)
    for machine in fleet.machines:
        if machine.exchange.join_state is JoinState.OUT:
            machine.exchange.join(**machine.totals)
    fleet.until(lambda: fleet.soil.exchange.joined == (1, 2, 3))
    fleet.ticks(5)
    assert fleet.is_balanced()


def test_joining_in_a_session_that_is_over_is_rejected() -> None:
    fleet = Fleet(2, expected=2)
    fleet.ticks(3)
    first = fleet.machines[0]
    session_id = first.exchange.session_id
    fleet.leave(first)
    again = FakeMachine(np.random.default_rng(5), 1, session_id=session_id - 1)
    fleet.machines[0] = again
    fleet.connect()
    again.exchange.join()  # in the session of the one before
    fleet.until(lambda: again.exchange.join_state is JoinState.OUT)
    assert again.exchange.rejection_reason
    again.exchange.join()
    fleet.until(lambda: again.exchange.joined)
    assert fleet.is_balanced()


def test_only_expected_machines_are_admitted_by_default() -> None:
    soil = SoilExchange(Welcome(GRID, lambda: np.zeros(GRID.shape)), expected=(1, 2))
    soil.receive(MachineHeader(soil.run_id, 9, 5, -1, Verb.JOIN))
    (rejection,) = soil.drain_outbox()
    assert isinstance(rejection, JoinRejected)
    assert (rejection.machine_id, rejection.session_id) == (9, 5)
    assert "expected_machines" in rejection.reason

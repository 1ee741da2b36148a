"""Machines that join late, leave, come back, crash and start again."""

import numpy as np
import pytest
from support.exchange_fakes import ExchangeDriver, FakeMachine, FakeSoil

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe, MachineHeader, RowChunk, Stream, Verb
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from msg_bridge.exchange.direct_transport import DirectTransport
from msg_bridge.exchange.machine_exchange import JoinState, MachineExchange
from msg_bridge.testing import LossyTransport

GOOD: dict[str, float] = {}
BAD = {"drop": 0.2, "duplicate": 0.2, "delay": 0.4}


class Crowd(ExchangeDriver):
    """A driver whose machines may change."""

    def __init__(self, count: int, expected: int, seed: int = 0, **loss: float) -> None:
        soil = FakeSoil(np.random.default_rng(seed), expected=tuple(range(1, expected + 1)))
        machines = [FakeMachine(np.random.default_rng(seed + n), n) for n in range(1, count + 1)]
        self._loss, self._seed = loss, seed
        super().__init__(soil, machines, DirectTransport(soil.exchange, []))
        self.connect()
        for machine in machines[:expected]:
            machine.exchange.join()

    def connect(self) -> None:
        """A transport to the machines as they are now."""
        ends = [machine.exchange for machine in self.machines]
        if self._loss:
            rng = np.random.default_rng(self._seed)
            self.transport = LossyTransport(self.soil.exchange, ends, rng, **self._loss)
        else:
            self.transport = DirectTransport(self.soil.exchange, ends)

    def until_ready(self, machine: FakeMachine) -> None:
        """Let a machine's tick be answered, and send no further one."""
        for _ in range(100):
            self.transport.deliver()
            self.soil.step()
            if machine.exchange.join_state is JoinState.READY:
                return
            answer = machine.exchange.poll()
            if answer is not None:
                machine.apply(answer.conversions)
        raise AssertionError("no answer")

    def balanced(self) -> bool:
        return {ledger.imbalance for ledger in self.soil.ledgers} == {0}


def test_the_first_tick_waits_for_every_expected_machine() -> None:
    crowd = Crowd(2, expected=2)
    first, second = crowd.machines
    second.exchange = MachineExchange(2)
    crowd.connect()
    crowd.transport.deliver()
    assert crowd.soil.exchange.poll() is None
    second.exchange.join()
    crowd.transport.deliver()
    assert crowd.soil.exchange.poll() is not None
    assert not first.exchange.joined


@pytest.mark.parametrize("loss", [GOOD, BAD])
def test_a_machine_joins_later_at_a_tick_boundary(loss: dict[str, float]) -> None:
    crowd = Crowd(2, expected=1, **loss)
    crowd.ticks(10)
    late = crowd.machines[1]
    late.exchange.join()
    crowd.until(lambda: len(late.applied) > 20)
    assert crowd.soil.exchange.joined == (1, 2)
    assert late.exchange.keyframe is not None
    assert crowd.balanced()


@pytest.mark.parametrize("loss", [GOOD, BAD])
def test_what_a_leaving_machine_holds_is_absent_until_it_is_back(loss: dict[str, float]) -> None:
    crowd = Crowd(2, expected=2, **loss)
    crowd.ticks(20)
    goes = crowd.machines[1]
    crowd.leave(goes)
    assert goes.held > 0
    crowd.ticks(20)
    assert crowd.soil.exchange.joined == (1,)
    assert crowd.soil.ledgers[-1].absent == goes.held
    before = len(goes.applied)
    goes.exchange.join(**goes.totals)
    crowd.until(lambda: len(goes.applied) > before + 30)
    assert crowd.soil.ledgers[-1].absent == 0
    assert crowd.balanced()


def test_rows_of_the_last_tick_are_owed_and_come_with_the_return() -> None:
    crowd = Crowd(1, expected=1)
    machine = crowd.machines[0]
    machine.rows_per_tick = 0
    crowd.ticks(3)
    assert machine.held == 0
    crowd.until_ready(machine)
    machine.exchange.send(
        empty_rows(SWEEP, 3), empty_rows(DEPOSIT_REQUEST), **machine.totals, leave=True
    )
    crowd.leave(machine)
    assert machine.held == 0
    machine.exchange.join()
    crowd.ticks(3)
    assert machine.held == crowd.soil.ledgers[0].terrain - crowd.soil.terrain
    assert crowd.balanced()


def test_two_machines_leave_in_successive_ticks() -> None:
    crowd = Crowd(3, expected=3)
    crowd.ticks(10)
    crowd.leave(crowd.machines[0])
    crowd.leave(crowd.machines[1])
    crowd.leave(crowd.machines[2])
    assert crowd.soil.exchange.joined == ()
    assert crowd.balanced()
    crowd.machines[0].exchange.join(**crowd.machines[0].totals)
    crowd.ticks(5)
    assert crowd.balanced()


def test_a_crashed_machine_starts_again_empty_and_what_it_held_stays_absent() -> None:
    crowd = Crowd(2, expected=2, **BAD)
    crowd.ticks(15)
    held = crowd.machines[1].held
    assert held > 0
    crowd.machines[1] = FakeMachine(np.random.default_rng(99), 2, session_id=10)
    crowd.connect()
    crowd.machines[1].exchange.join()
    crowd.ticks(20)
    assert crowd.soil.exchange.joined == (1, 2)
    lost = crowd.soil.ledgers[-1].absent
    assert lost > 0
    assert crowd.balanced()
    # It can leave and come back in its new life like any other.
    crowd.leave(crowd.machines[1])
    crowd.ticks(3)
    crowd.machines[1].exchange.join(**crowd.machines[1].totals)
    crowd.ticks(10)
    assert crowd.soil.exchange.joined == (1, 2)
    assert crowd.soil.ledgers[-1].absent == lost
    assert crowd.balanced()


def test_a_machine_cannot_come_back_with_soil_nobody_misses() -> None:
    crowd = Crowd(2, expected=2)
    crowd.ticks(10)
    cheat = crowd.machines[1]
    crowd.leave(cheat)
    cheat.exchange.join(pending_mm3=cheat.totals["pending_mm3"] + 5, particles_mm3=0)
    crowd.ticks(5)
    assert crowd.soil.exchange.joined == (1,)
    assert cheat.exchange.join_state is JoinState.OUT
    assert "it left with" in cheat.exchange.rejection_reason
    assert crowd.balanced()


def test_joining_twice_is_refused() -> None:
    crowd = Crowd(1, expected=1)
    crowd.ticks(2)
    with pytest.raises(ExchangeError, match="can join once out"):
        crowd.machines[0].exchange.join()


def test_a_late_copy_of_an_old_join_changes_nothing() -> None:
    crowd = Crowd(2, expected=2)
    machine = crowd.machines[1].exchange
    crowd.ticks(5)
    crowd.leave(crowd.machines[1])
    first_word = MachineHeader(machine.run_id, 2, machine.session_id, -1, Verb.JOIN)
    crowd.soil.exchange.receive(first_word)
    crowd.ticks(5)
    assert crowd.soil.exchange.joined == (1,)
    assert crowd.balanced()


def test_rows_of_a_former_life_are_not_taken_for_this_one() -> None:
    crowd = Crowd(2, expected=2)
    crowd.ticks(5)
    machine = crowd.machines[1]
    crowd.leave(machine)
    machine.rows_per_tick = 0
    seen = len(crowd.soil.sweeps_seen)
    machine.exchange.join(**machine.totals)
    crowd.until(lambda: machine.exchange.joined)
    stale = empty_rows(SWEEP, 5)
    stale["machine_id"], stale["seq"] = 2, np.arange(1, 6)
    crowd.soil.exchange.receive(
        RowChunk(1, Stream.SWEEP, 2, machine.exchange.session_id - 1, stale)
    )
    machine.rows_per_tick = 8
    crowd.ticks(5)
    own = [seq for machine_id, seq in crowd.soil.sweeps_seen[seen:] if machine_id == 2]
    assert own == list(range(1, len(own) + 1))
    assert crowd.balanced()


def test_another_machines_keyframe_hides_no_change() -> None:
    crowd = Crowd(1, expected=1)
    crowd.ticks(3)
    machine = crowd.machines[0].exchange
    crowd.until_ready(crowd.machines[0])
    tick = machine.tick
    machine.send(empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST), **crowd.machines[0].totals)
    newest = Keyframe(1, 10_000, crowd.soil.exchange._grid, np.zeros((4, 4)))
    machine.receive(newest)
    crowd.transport.deliver()
    crowd.soil.step()
    crowd.transport.deliver()
    answer = machine.poll()
    assert answer is not None
    assert answer.tick == tick + 1
    assert answer.map_updates.size == 3


def test_a_terrain_older_than_the_welcome_is_not_joined_on() -> None:
    crowd = Crowd(2, expected=1)
    crowd.ticks(10)
    late = crowd.machines[1].exchange
    late.join()
    late.receive(Keyframe(1, 2, crowd.soil.exchange._grid, np.zeros((4, 4))))
    crowd.until(lambda: late.joined)
    assert late.keyframe is not None
    assert late.keyframe.revision >= late.tick


def test_a_machine_that_is_out_keeps_nothing_of_what_it_overhears() -> None:
    crowd = Crowd(2, expected=1)
    crowd.ticks(50)
    overheard = crowd.machines[1].exchange
    overheard.join()
    assert overheard.drain_outbox()  # its request, and nothing else
    assert overheard.num_buffered_rows == 0


@pytest.mark.parametrize("seed", range(6))
def test_random_comings_and_goings_over_a_bad_transport_lose_nothing(seed: int) -> None:
    crowd = Crowd(3, expected=3, seed=seed, drop=0.3, duplicate=0.2, delay=0.6)
    rng = np.random.default_rng(100 + seed)
    for _ in range(12):
        crowd.ticks(int(rng.integers(1, 6)))
        machine = crowd.machines[int(rng.integers(1, 3))]
        fate = rng.random()
        if machine.exchange.join_state is JoinState.OUT:
            machine.exchange.join(**machine.totals)
        elif fate < 0.6 and machine.exchange.joined:
            crowd.leave(machine)
        elif fate < 0.8:
            k = crowd.machines.index(machine)
            session_id = machine.exchange.session_id
            crowd.machines[k] = FakeMachine(rng, machine.exchange.machine_id, session_id=session_id)
            crowd.connect()
            crowd.machines[k].exchange.join()
    for machine in crowd.machines:
        if machine.exchange.join_state is JoinState.OUT:
            machine.exchange.join(**machine.totals)
    crowd.until(lambda: crowd.soil.exchange.joined == (1, 2, 3))
    crowd.ticks(5)
    assert crowd.balanced()


def test_a_life_that_is_over_is_refused_with_a_word() -> None:
    crowd = Crowd(2, expected=2)
    crowd.ticks(3)
    first = crowd.machines[0]
    session_id = first.exchange.session_id
    crowd.leave(first)
    again = FakeMachine(np.random.default_rng(5), 1, session_id=session_id - 1)
    crowd.machines[0] = again
    crowd.connect()
    again.exchange.join()  # with the life that the one before had
    crowd.until(lambda: again.exchange.join_state is JoinState.OUT)
    assert "has had life" in again.exchange.rejection_reason
    again.exchange.join()
    crowd.until(lambda: again.exchange.joined)
    assert crowd.balanced()

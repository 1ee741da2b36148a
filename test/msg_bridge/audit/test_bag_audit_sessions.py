"""Bags of runs with releases and with several processes of a machine pass."""

import random

import pytest
from support.recorded_exchange import RecordedRun, ScriptedMachine, scripted_run

from msg_bridge.contract.rows import MAP_UPDATE, empty_rows
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange

NO_SOIL = {"pending_mm3": 0, "particles_mm3": 0}


def step(run: RecordedRun, ticks: int) -> None:
    for _ in range(ticks):
        run.step()


def drop(run: RecordedRun, machine_id: int) -> None:
    run.soil_endpoint.drop(machine_id)
    run.machine_endpoints[machine_id].abandon_session()
    run.step()


def assert_passes(audit, run: RecordedRun) -> None:
    assert run.soil_endpoint.ledger.imbalance == 0
    run.keyframe()
    report = audit(run.recording)
    assert report.passed, report.runs[0].findings


def test_release_of_rows_in_flight_to_an_empty_machine_passes(audit) -> None:
    run = scripted_run(2)
    run.step()
    assert run.simulated_machines[2].totals == NO_SOIL
    drop(run, 2)
    assert run.release(2, pieces=2) > 0
    run.rejoin(2, **NO_SOIL)
    step(run, 6)
    assert_passes(audit, run)


def test_releases_while_the_machine_is_joined_and_after_it_was_dropped_pass(audit) -> None:
    run = scripted_run(2)
    step(run, 10)
    run.crash(2, ScriptedMachine(9, y=0.5))
    step(run, 8)
    assert run.release_ended(2) > 0
    step(run, 4)
    drop(run, 2)
    assert run.soil_endpoint.ledger.in_flight != 0
    assert run.release(2, pieces=2) > 0
    step(run, 3)
    assert_passes(audit, run)


def test_release_in_the_tick_that_drops_a_session_without_ticks_passes(audit) -> None:
    run = scripted_run(2)
    step(run, 10)
    drop(run, 2)
    run.rejoin(2, **run.simulated_machines[2].totals)
    run.soil_endpoint.drop(2)
    run.machine_endpoints[2].abandon_session()
    assert run.release(2, pieces=2) > 0
    step(run, 3)
    assert_passes(audit, run)


class RandomSessions:
    """Random ends of sessions in a run of two machines, each with several processes."""

    def __init__(self, seed: int) -> None:
        self.run = scripted_run(2)
        self._rng = random.Random(seed)
        self._processes: dict[int, list[tuple[ScriptedMachine, MachineExchange]]] = {1: [], 2: []}

    def end_session(self) -> None:
        """Let a random machine crash, leave, be dropped or be replaced, and release soil."""
        run, rng = self.run, self._rng
        step(run, rng.randrange(1, 4))
        machine_id = rng.choice([1, 2])
        processes = self._processes[machine_id]
        event = rng.choice(["crash", "leave", "drop", "swap", "swap", "release"])
        if event == "release":
            if machine_id in run.soil_endpoint.accounts.ended_volumes:
                run.release_ended(machine_id)
            return
        if event == "crash" or not processes:
            processes.append(self._process(machine_id))
            session_id = rng.randrange(2**31)
            run.crash(machine_id, self._new_machine(machine_id), session_id=session_id)
            run.step()
        elif event == "swap":
            run.soil_endpoint.drop(machine_id)
            former = self._process(machine_id)
            chosen = processes.pop(rng.randrange(len(processes)))
            run.simulated_machines[machine_id], run.machine_endpoints[machine_id] = chosen
            processes.append(former)
            self._rejoin(machine_id)
        else:
            self._leave_or_drop(machine_id, event)
            self._rejoin(machine_id)

    def _leave_or_drop(self, machine_id: int, event: str) -> None:
        run = self.run
        if event == "drop":
            drop(run, machine_id)
        else:
            run.step(leaving=[machine_id])
            while run.machine_endpoints[machine_id].join_state is not JoinState.OUT:
                run.step()
        if self._rng.random() < 0.4 and machine_id in run.soil_endpoint.accounts.absent:
            run.release(machine_id, pieces=2)

    def _process(self, machine_id: int) -> tuple[ScriptedMachine, MachineExchange]:
        return self.run.simulated_machines[machine_id], self.run.machine_endpoints[machine_id]

    def _new_machine(self, machine_id: int) -> ScriptedMachine:
        return ScriptedMachine(self._rng.randrange(1000), y=1.5 * (machine_id - 1.5))

    def _rejoin(self, machine_id: int) -> None:
        """Rejoin with the soil that the machine holds, or without if that was released."""
        end = self.run.machine_endpoints[machine_id]
        if end.join_state is not JoinState.OUT:
            end.abandon_session()
        end.join(**self.run.simulated_machines[machine_id].totals)
        self.run.step()
        if not end.joined:
            assert end.rejection_reason.startswith("rejoin_volume")
            end.discard_soil()
            self.run.simulated_machines[machine_id] = self._new_machine(machine_id)
            end.join(**NO_SOIL)
            self.run.step()
        assert end.joined
        machine = self.run.simulated_machines[machine_id]
        machine.apply(end.backlog, empty_rows(MAP_UPDATE))
        machine.repeat_deposit_requests()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_run_with_random_sessions_and_releases_passes(audit, seed: int) -> None:
    sessions = RandomSessions(seed)
    for _ in range(40):
        sessions.end_session()
    assert_passes(audit, sessions.run)

"""Commands in a run: when they take effect, and which ticks wait for them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.machine_runs import MakeRun, Soil, machine_runs, valid_command

from machine_sim.node.command_scheduler import CommandScheduler
from machine_sim.node.params import MachineInstanceParams


@pytest.fixture
def make() -> Iterator[MakeRun]:
    with machine_runs() as make:
        yield make


def test_commands_time_out_by_simulation_time_in_lockstep_and_by_wall_time_in_real_time(
    make: MakeRun,
) -> None:
    for realtime in (False, True):
        run = make(realtime=realtime)
        soil, (scheduler,) = Soil(run), run.schedulers
        timeout = scheduler.arbiter.params.command_timeout
        run.apply_commands(70.0)
        scheduler.arbiter.receive_front([0.3, 0.0, 0.0, 0.0], scheduler.command_time(70.0))
        ticks = round(1.5 * timeout / 0.01)
        speeds = []
        for tick in range(ticks):  # the wall clock runs twice as fast as simulation time
            (applied,) = run.apply_commands(70.0 + 0.005 * tick)
            speeds.append(applied.joints[0])
            run.step()
            soil.answer()
        assert speeds[0] == 0.3
        assert (speeds[-1] == 0.0) is not realtime


def test_command_applies_in_the_tick_that_begins_now(make: MakeRun) -> None:
    run = make()
    soil = Soil(run)
    run.schedulers[0].arbiter.receive_front(
        [0.3, 0.0, 0.0, 0.0], run.schedulers[0].command_time(0.0)
    )
    (applied,) = run.apply_commands(0.0)
    assert applied.joints.tolist() == [0.3, 0.0, 0.0, 0.0]
    before = run.sim.machine.joint_positions[0]
    run.step()
    soil.answer()
    soil.ticks(60)
    assert run.sim.machine.joint_positions[0] > before + 0.02


def test_waiting_machine_steps_once_the_command_has_arrived(
    make: MakeRun,
) -> None:
    run = make(command_wait_period=1)
    soil = Soil(run)
    assert not run.can_step
    run.schedulers[0].receive(0.0, valid_command)
    assert run.can_step
    soil.ticks(1)
    assert not run.can_step
    run.schedulers[0].receive(0.0, valid_command)
    assert not run.can_step
    run.schedulers[0].receive(0.01, valid_command)
    assert run.can_step


def test_each_machine_of_a_node_has_its_own_wait_period(make: MakeRun) -> None:
    run = make(
        MachineInstanceParams(y=9.0),
        MachineInstanceParams(y=-9.0, command_wait_period=1),
        command_wait_period=1,
    )
    Soil(run)
    run.schedulers[0].receive(0.0, valid_command)
    assert not run.can_step
    run.schedulers[2].receive(0.0, valid_command)
    assert run.can_step


def test_each_machine_of_a_node_has_its_own_commands(make: MakeRun) -> None:
    run = make(MachineInstanceParams(y=9.0))
    Soil(run)
    run.schedulers[1].arbiter.receive_front([0.0, 0.1, 0.0, 0.0], 0.0)
    first, second = run.apply_commands(0.0)
    assert (first.joints.tolist(), second.joints.tolist()) == ([0.0] * 4, [0.0, 0.1, 0.0, 0.0])


def test_machine_waits_once_per_wait_period(make: MakeRun) -> None:
    run = make(command_wait_period=3)
    soil, waited = Soil(run), []
    for tick in range(7):
        if not run.can_step:
            waited.append(tick)
        run.schedulers[0].receive(run.schedulers[0].sim_time, valid_command)
        soil.ticks(1)
    assert waited == [0, 3, 6]


def test_early_command_is_not_awaited_again(make: MakeRun) -> None:
    run = make(command_wait_period=1)
    soil = Soil(run)
    run.schedulers[0].receive(0.02, valid_command)
    for _ in range(3):
        assert run.can_step
        soil.ticks(1)
    assert not run.can_step


def test_command_takes_effect_command_delay_ticks_after_its_stamp(
    make: MakeRun,
) -> None:
    run = make(command_wait_period=2, command_delay=2)
    soil, boom = Soil(run), 1

    def send(stamp: float, velocity: float) -> None:
        def deliver(effect_time: float | None) -> bool:
            run.schedulers[0].arbiter.receive_joints(
                ["boom"], [velocity], [], run.schedulers[0].sim_time, effect_time=effect_time
            )
            return True

        run.schedulers[0].receive(stamp, deliver)

    def applied() -> float:
        return float(soil.tick()[0].joints[boom])

    send(0.0, 0.1)
    before = [applied(), applied()]
    send(0.02, 0.2)
    assert before + [applied() for _ in range(4)] == [0.0, 0.0, 0.1, 0.1, 0.2, 0.2]


def test_machine_continues_for_the_delay_while_a_command_is_awaited(make: MakeRun) -> None:
    run = make(command_wait_period=2, command_delay=2)
    soil, waited = Soil(run), []
    for tick in range(8):
        if not run.can_step:
            waited.append(tick)
            run.schedulers[0].receive((tick - 2) * 0.01, valid_command)
        soil.ticks(1)
    assert waited == [2, 4, 6]


def test_late_command_takes_effect_at_once(make: MakeRun) -> None:
    run = make(command_delay=2)
    soil, delivered = Soil(run), []
    soil.ticks(5)
    run.schedulers[0].receive(0.01, lambda effect: not delivered.append(effect))
    assert delivered == [None]


@pytest.mark.parametrize("delay", [0, 2])
def test_answers_to_a_repeated_state_change_nothing(make: MakeRun, delay: int) -> None:
    """The joint of the first answers expires later than they arrive again."""
    applied: list[list[float]] = []
    for num_repetitions in (0, 3):
        run = make(command_wait_period=1, command_delay=delay)
        soil, scheduler = Soil(run), run.schedulers[0]

        def answer(tick: int, scheduler: CommandScheduler = scheduler) -> None:
            def deliver(effect_time: float | None) -> bool:
                joint = "boom" if tick < 3 else "arm"
                scheduler.arbiter.receive_joints(
                    [joint], [0.1 + 0.01 * tick], [], scheduler.sim_time, effect_time=effect_time
                )
                return True

            scheduler.receive(0.01 * tick, deliver)

        applied.append([])
        for tick in range(40):
            answer(tick)
            late = tick - delay - 1
            for _ in range(num_repetitions if late > 0 else 0):  # a stamp of 0 is none
                answer(late)
            applied[-1] += soil.tick()[0].joints.tolist()
    assert applied[0] == applied[1]
    assert pytest.approx(0.12) in applied[0]


def test_commands_are_not_delayed_in_real_time(make: MakeRun) -> None:
    run = make(command_delay=5, realtime=True)
    Soil(run)
    delivered: list[float | None] = []
    run.schedulers[0].receive(0.0, lambda effect: not delivered.append(effect))
    assert delivered == [None]


def test_rejected_command_is_no_answer(make: MakeRun) -> None:
    run = make(command_wait_period=1)
    Soil(run)
    run.schedulers[0].receive(0.0, lambda _: False)
    assert not run.can_step


def test_resumed_run_awaits_each_answer_that_was_lost_until_later_ones_are_accepted(
    make: MakeRun,
) -> None:
    run = make(command_wait_period=1, command_delay=2)
    soil = Soil(run)

    def answer(tick: int) -> None:
        scheduler = run.schedulers[0]  # another one after each restart

        def deliver(effect_time: float | None) -> bool:
            scheduler.arbiter.receive_joints(
                ["boom"], [0.1], [], scheduler.sim_time, effect_time=effect_time
            )
            return True

        scheduler.receive(0.01 * tick, deliver)

    for tick in range(5):
        answer(tick)
        soil.ticks(1)
    answer(5)  # the answer to 4 has arrived, those to 3 and 5 are lost with the process
    state = run.state
    kept = tuple(
        each for each in state.arbiters[0].delayed if each.effect_time == pytest.approx(0.06)
    )
    run.resume(state._replace(arbiters=(state.arbiters[0]._replace(delayed=kept),)))
    assert run.tick == 5
    assert run.unanswered_ticks == {3, 5}
    answer(5)
    assert not run.can_step, "the answer to 3 is missing"
    answer(3)
    soil.ticks(2)
    assert run.unanswered_ticks == frozenset()
    run.resume(run.state._replace(arbiters=(run.state.arbiters[0]._replace(delayed=()),)))
    answer(run.tick)
    assert not run.can_step
    run.accept_later_answers()
    assert run.can_step


def test_commands_are_not_awaited_in_real_time(make: MakeRun) -> None:
    run = make(command_wait_period=1, realtime=True)
    Soil(run)
    assert run.can_step


def test_stamp_of_another_clock_is_no_answer(make: MakeRun) -> None:
    run = make(command_wait_period=1)
    Soil(run)
    run.schedulers[0].receive(1.7e9, valid_command)  # seconds since 1970
    assert not run.can_step

"""Random driving and digging: no failure, exact volume balance, equal runs for equal seeds."""

from collections.abc import Callable, Iterator

import pytest

from benchmarks.random_digging import RandomOperator
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel


@pytest.fixture
def make_operator() -> Iterator[Callable[[TrackModel, int], RandomOperator]]:
    """Return a function that makes an operator; all worlds are closed after the test."""
    operators = []

    def make(model: TrackModel, seed: int) -> RandomOperator:
        operators.append(RandomOperator(model, seed))
        return operators[-1]

    yield make
    for operator in operators:
        operator.close()


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("model", TRACK_MODELS)
def test_machine_works_for_a_minute_without_a_problem(make_operator, model, seed) -> None:
    outcome = make_operator(model, seed).run(60.0)
    assert outcome.problem == ""
    assert outcome.imbalance == 0
    assert outcome.max_stuck_time < 10.0
    # Of 20 seeds the slowest drives 4 m, and some take soil into the bucket only by chance.
    assert outcome.distance > 2.0


def test_equal_seeds_give_equal_state_hashes(make_operator) -> None:
    first, second = make_operator("kinematic", 4), make_operator("kinematic", 4)
    first.run(5.0)
    second.run(5.0)
    assert first.sim.state_hash() == second.sim.state_hash()


def test_machine_that_cannot_drive_is_reported_as_stuck(make_operator, monkeypatch) -> None:
    operator = make_operator("kinematic", 6)
    command = operator.sim.command
    monkeypatch.setattr(operator.sim, "command", lambda joints, tracks: command(joints, 0 * tracks))
    assert operator.run(20.0).max_stuck_time > 5.0

"""A machine that drives and digs about at random stays sound; `benchmarks/random_digging.py`."""

from collections.abc import Callable, Iterator

import pytest

from benchmarks.random_digging import RandomOperator
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel


@pytest.fixture
def careless() -> Iterator[Callable[[TrackModel, int], RandomOperator]]:
    """Let operators loose; their worlds are closed after the test."""
    made = []

    def make(model: TrackModel, seed: int) -> RandomOperator:
        made.append(RandomOperator(model, seed))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("model", TRACK_MODELS)
def test_a_minute_of_careless_work_leaves_machine_and_ledger_sound(careless, model, seed) -> None:
    did = careless(model, seed).run(60.0)
    assert did.problem == ""
    assert did.imbalance == 0
    assert did.max_stuck_time < 10.0
    assert did.distance > 10.0
    assert did.moved > 0.3


def test_equal_operators_do_equal_work(careless) -> None:
    first, second = careless("kinematic", 4), careless("kinematic", 4)
    first.run(5.0)
    second.run(5.0)
    assert first.sim.state_hash() == second.sim.state_hash()


def test_a_machine_that_does_not_get_away_is_told_to_be_stuck(careless, monkeypatch) -> None:
    operator = careless("kinematic", 6)
    command = operator.sim.command
    monkeypatch.setattr(operator.sim, "command", lambda joints, tracks: command(joints, 0 * tracks))
    assert operator.run(20.0).max_stuck_time > 5.0

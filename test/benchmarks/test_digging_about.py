"""A machine that drives and digs about at random stays sound; `benchmarks/digging_about.py`."""

from collections.abc import Callable, Iterator

import pytest

from benchmarks.digging_about import Careless
from machine_sim.machine.tracks.model import TRACK_MODELS, TrackModel


@pytest.fixture
def careless() -> Iterator[Callable[[TrackModel, int], Careless]]:
    """Let operators loose; their worlds are closed after the test."""
    made = []

    def make(model: TrackModel, seed: int) -> Careless:
        made.append(Careless(model, seed))
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
    assert did.stuck < 10.0
    assert did.way > 10.0
    assert did.moved > 0.3


def test_equal_operators_do_equal_work(careless) -> None:
    first, second = careless("fast", 4), careless("fast", 4)
    first.run(5.0)
    second.run(5.0)
    assert first.sim.state_hash() == second.sim.state_hash()


def test_a_machine_that_does_not_get_away_is_told_to_be_stuck(careless, monkeypatch) -> None:
    operator = careless("fast", 6)
    command = operator.sim.command
    monkeypatch.setattr(operator.sim, "command", lambda joints, tracks: command(joints, 0 * tracks))
    assert operator.run(20.0).stuck > 5.0

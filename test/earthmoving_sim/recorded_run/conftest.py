"""One recorded run, its outcome, and outcomes of changed recordings of it."""

from collections.abc import Callable, Iterator

import pytest
from support.recorded_dig import RecordedDig, small_site, write

from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.recorded_run.outcome import outcome_from_bag


@pytest.fixture(scope="session")
def dig() -> Iterator[RecordedDig]:
    """A run that is aborted in its first drag."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        run = RecordedDig(
            monkeypatch, small_site(), approach_distance=0.0, start_x=-2.0, timeout=6.0
        )
    yield run
    run.run.close()


@pytest.fixture(scope="session")
def recorded(dig, tmp_path_factory) -> DigOutcome:
    return outcome_from_bag(write(tmp_path_factory.mktemp("bags") / "dig", dig.recording))


@pytest.fixture
def outcome(tmp_path) -> Callable[..., DigOutcome]:
    """Write a recording as a bag and return its outcome."""
    return lambda recording, **options: outcome_from_bag(
        write(tmp_path / "bag", recording, **options)
    )

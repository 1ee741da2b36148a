"""Invalidation of derived data: what each change makes stale."""

import pytest

from machine_sim.dem.invalidation import (
    BODY_RECORDS,
    CONTACT_BLOCKS,
    INITIAL_RADII,
    NEIGHBOUR_LIST,
    STALE_AFTER,
    Change,
    Invalidation,
)

PERSISTENT = (NEIGHBOUR_LIST, CONTACT_BLOCKS, BODY_RECORDS)


@pytest.fixture
def invalidation() -> Invalidation:
    """An invalidation after a step that has rebuilt everything."""
    rebuilt = Invalidation()
    rebuilt.mark_rebuilt(*PERSISTENT)
    return rebuilt


def test_all_persistent_data_is_stale_at_first() -> None:
    invalidation = Invalidation()
    assert all(derived in invalidation.stale for derived in PERSISTENT)
    assert INITIAL_RADII not in invalidation.stale


@pytest.mark.parametrize("change", Change)
def test_every_change_makes_exactly_the_listed_data_stale(
    invalidation: Invalidation, change: Change
) -> None:
    invalidation.record(change)
    for derived in (*PERSISTENT, INITIAL_RADII):
        assert (derived in invalidation.stale) == (derived in STALE_AFTER[change])
    assert CONTACT_BLOCKS in invalidation.stale, "blocks depend on everything else"


def test_rebuilt_data_is_valid_while_other_data_stays_stale(invalidation: Invalidation) -> None:
    invalidation.record(Change.PARTICLES_WOKEN)
    invalidation.mark_rebuilt(NEIGHBOUR_LIST)
    assert NEIGHBOUR_LIST not in invalidation.stale
    assert CONTACT_BLOCKS in invalidation.stale

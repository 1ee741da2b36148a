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
    assert all(invalidation.is_stale(derived) for derived in PERSISTENT)
    assert not invalidation.is_stale(INITIAL_RADII)


@pytest.mark.parametrize("change", Change)
def test_every_change_makes_exactly_the_listed_data_stale(
    invalidation: Invalidation, change: Change
) -> None:
    invalidation.record(change)
    for derived in (*PERSISTENT, INITIAL_RADII):
        assert invalidation.is_stale(derived) == (derived in STALE_AFTER[change])
    assert invalidation.is_stale(CONTACT_BLOCKS), "blocks depend on everything else"


def test_rebuilt_data_is_valid_while_other_data_stays_stale(invalidation: Invalidation) -> None:
    invalidation.record(Change.PARTICLES_WOKEN)
    invalidation.mark_rebuilt(NEIGHBOUR_LIST)
    assert not invalidation.is_stale(NEIGHBOUR_LIST)
    assert invalidation.is_stale(CONTACT_BLOCKS)

"""Invalidation of derived data: what each change makes stale."""

import pytest

from machine_sim.dem.invalidation import STALE_AFTER, Change, Derived, Invalidation

PERSISTENT = (Derived.NEIGHBOUR_LIST, Derived.CONTACT_BLOCKS, Derived.BODY_RECORDS)


@pytest.fixture
def invalidation() -> Invalidation:
    """An invalidation after a step that has rebuilt everything."""
    rebuilt = Invalidation()
    rebuilt.mark_rebuilt(*PERSISTENT)
    return rebuilt


def test_all_persistent_data_is_stale_at_first() -> None:
    invalidation = Invalidation()
    assert all(invalidation.is_stale(derived) for derived in PERSISTENT)
    assert not invalidation.is_stale(Derived.INITIAL_RADII)


@pytest.mark.parametrize("change", Change)
def test_every_change_makes_exactly_the_listed_data_stale(
    invalidation: Invalidation, change: Change
) -> None:
    invalidation.record(change)
    for derived in Derived:
        assert invalidation.is_stale(derived) == (derived in STALE_AFTER[change])
    assert invalidation.is_stale(Derived.CONTACT_BLOCKS), "blocks depend on everything else"


def test_rebuilt_data_is_valid_while_other_data_stays_stale(invalidation: Invalidation) -> None:
    invalidation.record(Change.PARTICLES_WOKEN)
    invalidation.mark_rebuilt(Derived.NEIGHBOUR_LIST)
    assert not invalidation.is_stale(Derived.NEIGHBOUR_LIST)
    assert invalidation.is_stale(Derived.CONTACT_BLOCKS)

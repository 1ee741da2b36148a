"""The table of particles: rows are found by id, whatever their order."""

import numpy as np
import pytest

from machine_sim.particles.store import ParticleError, ParticleStore


@pytest.fixture
def store() -> ParticleStore:
    store = ParticleStore(100)
    store.add(6)
    store.reorder(np.array([4, 0, 5, 2]))
    return store


def test_rows_come_in_the_order_of_the_ids(store: ParticleStore) -> None:
    assert store.particle_id.tolist() == [5, 1, 6, 3]
    assert store.rows([6, 3, 5]).tolist() == [2, 3, 0]
    assert store.rows(np.array([1], dtype=np.uint32)).tolist() == [1]
    assert store.rows([]).size == 0


@pytest.mark.parametrize("ids", [[4], [7], [0], [1, 2], [-1]])
def test_an_id_that_is_not_alive_is_refused(store: ParticleStore, ids: list[int]) -> None:
    with pytest.raises(ParticleError, match="no live particle"):
        store.rows(ids)


def test_an_id_given_twice_is_refused(store: ParticleStore) -> None:
    with pytest.raises(ParticleError, match="twice"):
        store.rows([3, 1, 3])


def test_none_is_alive_in_an_empty_store() -> None:
    with pytest.raises(ParticleError, match="no live particle"):
        ParticleStore(10).rows([1])


def test_those_that_stay_keep_their_order_and_columns(store: ParticleStore) -> None:
    store.volume_mm3[:] = [50, 10, 60, 30]
    store.position[:, 2] = [5.0, 1.0, 6.0, 3.0]
    assert store.remove(store.rows([1])).tolist() == [0, 2, 3]
    assert store.particle_id.tolist() == [5, 6, 3]
    assert store.volume_mm3.tolist() == [50, 60, 30]
    assert store.position[:, 2].tolist() == [5.0, 6.0, 3.0]

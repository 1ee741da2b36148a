"""The state of particles: rows are found by id in any order."""

import numpy as np
import pytest

from machine_sim.dem.state import ParticleError, ParticleState


@pytest.fixture
def state() -> ParticleState:
    state = ParticleState(100)
    state.add(6)
    state.reorder(np.array([4, 0, 5, 2]))
    return state


def test_rows_are_in_the_order_of_the_ids(state: ParticleState) -> None:
    assert state.particle_id.tolist() == [5, 1, 6, 3]
    assert state.rows([6, 3, 5]).tolist() == [2, 3, 0]
    assert state.rows(np.array([1], dtype=np.uint32)).tolist() == [1]
    assert state.rows([]).size == 0


@pytest.mark.parametrize("ids", [[4], [7], [0], [1, 2], [-1]])
def test_unknown_id_is_rejected(state: ParticleState, ids: list[int]) -> None:
    with pytest.raises(ParticleError, match="does not exist"):
        state.rows(ids)


def test_duplicate_id_is_rejected(state: ParticleState) -> None:
    with pytest.raises(ParticleError, match="twice"):
        state.rows([3, 1, 3])


def test_no_id_is_known_in_an_empty_state() -> None:
    with pytest.raises(ParticleError, match="does not exist"):
        ParticleState(10).rows([1])


def test_remaining_rows_keep_their_order_and_columns(state: ParticleState) -> None:
    state.volume_mm3[:] = [50, 10, 60, 30]
    state.position[:, 2] = [5.0, 1.0, 6.0, 3.0]
    assert state.remove(state.rows([1])).tolist() == [0, 2, 3]
    assert state.particle_id.tolist() == [5, 6, 3]
    assert state.volume_mm3.tolist() == [50, 60, 30]
    assert state.position[:, 2].tolist() == [5.0, 6.0, 3.0]

"""A heap at rest does not move, although no particle sleeps."""

import pytest

from benchmarks.validation.heap_creep import resting_heap
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)


def test_small_heap_comes_to_rest():
    early, late = (
        resting_heap(SOIL, 300, settle_time=time, duration=0.5, allow_sleeping=False)
        for time in (0.5, 6.0)
    )
    assert early.num_particles == late.num_particles == 300
    assert late.energy < 1e-6 < early.energy
    assert late.creep < 0.1 < early.creep


@pytest.mark.slow
@pytest.mark.independent
def test_heap_at_rest_does_not_creep():
    result = resting_heap(SOIL, 5000, duration=60.0, allow_sleeping=False)
    assert result.energy < 1e-8
    assert result.creep < 1e-3

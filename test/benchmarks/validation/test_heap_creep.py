"""A heap left alone stays as it is, though nobody sleeps."""

import pytest

from benchmarks.validation.heap_creep import resting_heap
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)


def test_a_small_heap_calms_down():
    early, late = (
        resting_heap(SOIL, 300, settle=settle, watch=0.5, allow_sleeping=False)
        for settle in (0.5, 6.0)
    )
    assert early.particles == late.particles == 300
    assert late.energy < 1e-6 < early.energy
    assert late.creep < 0.1 < early.creep


@pytest.mark.slow
def test_a_heap_at_rest_does_not_creep():
    found = resting_heap(SOIL, 5000, watch=60.0, allow_sleeping=False)
    assert found.energy < 1e-8
    assert found.creep < 1e-3

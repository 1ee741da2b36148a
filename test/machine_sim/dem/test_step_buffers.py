"""Working memory of a step."""

import pytest

from machine_sim.dem.body_records import BODY_RECORD_SIZE
from machine_sim.dem.step_buffers import StepBuffers


@pytest.mark.parametrize("count", [1, 7, 100, 5000])
def test_every_record_is_one_cache_line(count: int) -> None:
    buffers = StepBuffers()
    buffers.reserve(count)
    for records in (buffers.memory.body, buffers.memory.force_sums):
        assert records.shape == (count, BODY_RECORD_SIZE)
        assert records.strides[0] == 64
        assert records.ctypes.data % 64 == 0

"""A bucket keeps its soil while it is carried, and pours it when it is tipped."""

import pytest

from benchmarks.validation.bucket_transport import transport_soil
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)


def test_a_small_load_is_carried_and_tipped():
    found = transport_soil(SOIL, 250, fill=0.6, tip_speed=40.0)
    assert found.particles == 250
    assert found.fill == pytest.approx(0.6)
    assert found.fraction_after_swing == found.fraction_after_stop == 1.0
    assert 30.0 < found.begins < found.half < found.most < 120.0
    assert found.left == 0.0
    assert found.tunnelled == 0


def test_what_finds_no_room_does_not_count():
    found = transport_soil(SOIL, 250, fill=2.0, tip_speed=40.0)
    assert found.particles < 200
    assert 1.0 < found.fill < 1.5
    assert found.fraction_after_stop < found.fraction_after_swing <= 1.0, (
        "a heap does not stand a hard stop"
    )


@pytest.mark.slow
@pytest.mark.parametrize("allow_load_locking", [True, False])
def test_a_full_bucket_keeps_its_soil_and_pours_it(allow_load_locking):
    found = transport_soil(SOIL, 2000, allow_load_locking=allow_load_locking)
    assert (found.max_locked_fraction > 0.9) == allow_load_locking, (
        "soil at rest rides as one body, if it may"
    )
    assert (found.max_locked_fraction == 0.0) != allow_load_locking
    assert found.fraction_after_stop >= 0.99
    assert 45.0 <= found.half <= 90.0
    assert found.between > 0.9
    assert found.begins >= 40.0
    assert found.most <= 90.0
    assert found.left == 0.0
    assert found.tunnelled == 0


@pytest.mark.slow
@pytest.mark.parametrize("allow_load_locking", [True, False])
def test_a_heaped_bucket_keeps_its_heap_while_it_swings(allow_load_locking):
    found = transport_soil(SOIL, 2000, fill=1.15, allow_load_locking=allow_load_locking)
    assert found.fill > 1.05
    assert found.fraction_after_swing >= 0.99
    assert found.left == 0.0
    assert found.tunnelled == 0

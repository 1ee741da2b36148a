"""A bucket keeps its soil while it is carried, and pours it when it is tipped."""

import pytest

from benchmarks.laboratory.carrying import carry
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)


def test_a_small_load_is_carried_and_tipped():
    found = carry(SOIL, 250, fill=0.6, tip_speed=40.0)
    assert found.particles == 250
    assert found.fill == pytest.approx(0.6)
    assert found.swung == found.retained == 1.0
    assert 30.0 < found.begins < found.half < found.most < 120.0
    assert found.left == 0.0
    assert found.tunnelled == 0


def test_what_finds_no_room_does_not_count():
    found = carry(SOIL, 250, fill=2.0, tip_speed=40.0)
    assert found.particles < 200
    assert 1.0 < found.fill < 1.5
    assert found.retained < found.swung <= 1.0, "a heap does not stand a hard stop"


@pytest.mark.slow
@pytest.mark.parametrize("carried", [True, False])
def test_a_full_bucket_keeps_its_soil_and_pours_it(carried):
    found = carry(SOIL, 2000, carried=carried)
    assert (found.rode > 0.9) == carried, "soil at rest rides as one body, if it may"
    assert (found.rode == 0.0) != carried
    assert found.retained >= 0.99
    assert 45.0 <= found.half <= 90.0
    assert found.between > 0.9
    assert found.begins >= 40.0
    assert found.most <= 90.0
    assert found.left == 0.0
    assert found.tunnelled == 0


@pytest.mark.slow
@pytest.mark.parametrize("carried", [True, False])
def test_a_heaped_bucket_keeps_its_heap_while_it_swings(carried):
    found = carry(SOIL, 2000, fill=1.15, carried=carried)
    assert found.fill > 1.05
    assert found.swung >= 0.99
    assert found.left == 0.0
    assert found.tunnelled == 0

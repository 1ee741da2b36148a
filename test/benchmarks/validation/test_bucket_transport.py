"""A bucket keeps its soil during transport and empties when it is tipped."""

import pytest

from benchmarks.validation.bucket_transport import transport_soil
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils.soil_types import load_soil_types

SOIL = LooseSoil(tool_friction=17.0)


def test_small_load_stays_in_the_bucket_until_it_is_tipped():
    result = transport_soil(SOIL, 250, fill=0.6, tip_speed=40.0)
    assert result.num_particles == 250
    assert result.fill == pytest.approx(0.6)
    assert result.fraction_after_swing == result.fraction_after_stop == 1.0
    assert 30.0 < result.tilt_at_2_percent < result.tilt_at_half < result.tilt_at_90_percent < 120.0
    assert result.final_fraction == 0.0
    assert result.num_tunnelled == 0


def test_particles_beside_the_bucket_do_not_count():
    result = transport_soil(SOIL, 250, fill=2.0, tip_speed=40.0)
    assert result.num_particles < 200
    assert 1.0 < result.fill < 1.5
    assert result.fraction_after_stop < result.fraction_after_swing <= 1.0, (
        "a part of the heap falls off at the hard stop"
    )


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.parametrize("allow_load_locking", [True, False])
def test_full_bucket_keeps_its_soil_and_empties(allow_load_locking):
    result = transport_soil(SOIL, 2000, allow_load_locking=allow_load_locking)
    assert (result.max_locked_fraction > 0.9) == allow_load_locking, (
        "a load at rest is locked if that is allowed"
    )
    assert (result.max_locked_fraction == 0.0) != allow_load_locking
    assert result.fraction_after_stop >= 0.99
    assert 45.0 <= result.tilt_at_half <= 90.0
    assert result.fraction_out_45_to_90 > 0.9
    assert result.tilt_at_2_percent >= 40.0
    assert result.tilt_at_90_percent <= 90.0
    assert result.final_fraction == 0.0
    assert result.num_tunnelled == 0


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.parametrize("allow_load_locking", [True, False])
def test_heaped_bucket_keeps_its_heap_during_a_swing(allow_load_locking):
    result = transport_soil(SOIL, 2000, fill=1.15, allow_load_locking=allow_load_locking)
    assert result.fill > 1.05
    assert result.fraction_after_swing >= 0.99
    assert result.final_fraction == 0.0
    assert result.num_tunnelled == 0


@pytest.mark.slow
@pytest.mark.independent
def test_wet_clay_sticks_and_pours_later_than_loam():
    """Over ten loads it began to pour 8 to 17 degrees later, and ended 10 or more later."""
    soils = load_soil_types()
    clay, loam = (
        transport_soil(soils[name].loose_soil, 250, tip_speed=20.0) for name in ("wet clay", "loam")
    )
    assert clay.tilt_at_2_percent > loam.tilt_at_2_percent + 4.0
    assert clay.tilt_at_half > loam.tilt_at_half + 4.0
    assert not clay.tilt_at_90_percent < loam.tilt_at_90_percent + 5.0  # nan: more than 10 % stayed
    assert clay.final_fraction > 0.0 == loam.final_fraction

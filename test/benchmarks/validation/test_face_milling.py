"""Milling by the road header: energy balances, rock stops the head, loam is faster than rock."""

import math

import pytest

from benchmarks.validation.face_milling import FaceSite, mill_face

HEAD_SPEED = 7.5
RATED_POWER = 132e3
FACE_X = 2.25
"""Position of the face [m]."""


@pytest.fixture
def rock():
    site = FaceSite("rock")
    site.drive(0.0, HEAD_SPEED, 1.2)
    yield site
    site.world.close()


def test_energy_balances_and_rate_is_within_the_power(rock: FaceSite) -> None:
    rock.drive(0.1, HEAD_SPEED, 1.5)  # to the face
    for _ in range(15):  # a gentle feed, as that of an operator
        rock.drive(0.03, HEAD_SPEED, 0.15)
        rock.drive(-0.03, HEAD_SPEED, 0.1)
    result = rock.result
    assert result.drive_work > 100e3
    assert abs(result.imbalance) < 0.05
    assert result.milling_work == pytest.approx(
        result.specific_energy * result.firm_volume, rel=0.02
    )
    max_rate = 3600.0 * RATED_POWER / result.specific_energy
    assert 20.0 < result.rate < 1.05 * max_rate
    assert max_rate == pytest.approx(60.0, rel=0.01)


def test_head_that_is_pressed_into_rock_stalls_and_stops_the_machine(rock: FaceSite) -> None:
    rock.drive(0.1, HEAD_SPEED, 2.4)
    assert abs(rock.head_speed) < 0.5 * HEAD_SPEED
    stalled_volume = rock.result.firm_volume
    rock.drive(0.1, HEAD_SPEED, 0.6)
    assert abs(rock.head_speed) < 0.5 * HEAD_SPEED
    assert rock.result.firm_volume - stalled_volume < 0.2 * stalled_volume
    # 0.15 m beyond the face were commanded; the head does not enter rock that it has not milled.
    assert rock.head_front < FACE_X + 0.06
    rock.drive(-0.3, HEAD_SPEED, 2.0)
    assert rock.head_speed == pytest.approx(HEAD_SPEED, rel=0.02)
    assert rock.result.milling_work < 1.02 * (rock.result.drive_work + rock.result.feed_work)


def test_head_that_does_not_spin_removes_no_rock(rock: FaceSite) -> None:
    rock.drive(0.0, 0.0, 2.0)
    rock.drive(0.1, 0.0, 2.5)
    assert rock.result.firm_volume == 0.0
    assert rock.head_front < FACE_X + 0.06


@pytest.mark.slow
@pytest.mark.independent
def test_loam_is_faster_than_rock_and_hardly_brakes_the_head_by_cuttings() -> None:
    (rock, rock_time), (loam, loam_time) = mill_face("rock"), mill_face("loam")
    assert abs(rock.imbalance) < 0.05
    assert 20.0 < rock.rate < 60.0
    assert loam_time < 0.5 * rock_time
    assert loam.cuttings_work < 0.5 * loam.milling_work
    # In loam a head needs little: 5 % of its work are 4 kJ, 0.2 % of what its drive could deliver.
    assert math.isclose(
        loam.drive_work,
        loam.milling_work + loam.cuttings_work + loam.kinetic_energy,
        rel_tol=0.10,
    )

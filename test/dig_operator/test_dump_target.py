"""BedTarget: where the bucket is opened over a bed, what is waited for, and what counts as load."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine
from support.operator_scenes import ARM, observation, tilted

from dig_operator import Observation
from dig_operator.dump_target import BedTarget
from dig_operator.observed_machine import ObservedMachine

DUMPER = load_shipped_machine("dumper")


def truck(x: float = 0.0, y: float = 5.8, **state: float) -> ObservedMachine:
    angle = state.pop("bed", 0.0)
    return ObservedMachine(
        "truck",
        DUMPER,
        np.array([x, y, 0.0]),
        tilted(yaw=math.pi),
        np.array([angle]),
        **state,
    )


def seen(*others: ObservedMachine) -> Observation:
    return replace(observation(), others=others)


def target() -> BedTarget:
    return BedTarget("truck", ARM, min_radius=4.4, max_radius=7.3, full_fill=0.8)


def test_bucket_is_opened_over_the_bed() -> None:
    azimuth, radius = target().aim(seen(truck()))
    assert azimuth == pytest.approx(0.5 * math.pi, abs=0.1)
    assert radius == pytest.approx(5.8, abs=0.6)


def test_bucket_is_opened_over_the_bed_from_a_tilted_base() -> None:
    roll = math.radians(5.0)
    upright = seen(truck())
    leaning = replace(upright, base_rotation=tilted(roll=roll))
    points = [target().aim(each) for each in (upright, leaning)]
    bases = [ARM.swing_axis(each) for each in (upright, leaning)]
    middles = [
        base[:2] + point.radius * np.array([math.cos(point.azimuth), math.sin(point.azimuth)])
        for base, point in zip(bases, points, strict=True)
    ]
    assert middles[1] == pytest.approx(middles[0], abs=1e-6)
    assert np.linalg.norm(bases[1] - bases[0]) > 0.05, "the swing axis leans out"


def test_load_is_not_counted_when_the_excavator_moves_along() -> None:
    bed = target()
    bed.count_dump(seen(truck(fill=0.4)))
    moved = replace(seen(truck(fill=0.4)), base_position=np.array([-5.0, 0.0, 0.0]))
    bed.watch(moved)
    assert bed.num_loads == 0


def test_load_begins_above_what_sticks_to_the_bed() -> None:
    bed = target()
    for fill, is_loading in [(0.0, False), (0.4, True), (0.8, True), (0.3, False), (0.1, False)]:
        bed.watch(seen(truck(fill=fill)))
        assert bed.is_loading is is_loading, fill
    bed.watch(seen(truck(fill=0.2)))
    assert bed.is_loading


def test_successive_buckets_are_spread_along_the_bed() -> None:
    bed = target()
    azimuths = []
    for _ in range(4):
        azimuths.append(bed.aim(seen(truck())).azimuth)
        bed.count_dump(seen(truck(fill=0.3)))
    assert len(set(azimuths[:3])) == 3
    assert azimuths[3] == azimuths[0]


@pytest.mark.parametrize(
    ("others", "reason"),
    [
        ((), "not known"),
        ((truck(speed=0.5),), "driving"),
        ((truck(bed=-0.4),), "raised"),
        ((truck(y=12.0),), "away"),
        ((truck(age=1.0),), "no messages"),
        ((truck(fill=0.85),), "full"),
    ],
)
def test_obstacle_names_what_is_waited_for(
    others: tuple[ObservedMachine, ...], reason: str
) -> None:
    assert reason in target().find_obstacle(seen(*others), is_swinging=False)


def test_machine_without_a_bed_is_an_obstacle_and_no_error() -> None:
    digger = load_shipped_machine("excavator")
    other = ObservedMachine("truck", digger, np.array([0.0, 6.0, 0.0]), np.eye(3), digger.home)
    bed = target()
    bed.watch(seen(other))
    assert "no bed" in bed.find_obstacle(seen(other), is_swinging=False)


def test_shaken_or_full_machine_does_not_stop_a_swing() -> None:
    assert target().find_obstacle(seen(truck(speed=0.1, fill=0.85)), is_swinging=True) == ""


def test_load_is_a_full_bed_or_one_that_is_driven_away() -> None:
    bed = target()
    bed.count_dump(seen(truck(fill=0.5)))
    bed.watch(seen(truck(fill=0.5)))
    assert bed.num_loads == 0
    bed.count_dump(seen(truck(fill=0.82)))
    bed.watch(seen(truck(x=-8.0, fill=0.82)))
    assert bed.num_loads == 1, "counted once"
    bed.watch(seen(truck(x=-8.0, fill=0.1)))  # some soil sticks to the bed
    bed.count_dump(seen(truck(fill=0.3)))
    bed.watch(seen(truck(x=-1.0, fill=0.3)))
    assert bed.num_loads == 1, "a machine that is moved within reach has not left"
    bed.watch(seen(truck(x=-8.0, fill=0.3)))
    assert bed.num_loads == 2

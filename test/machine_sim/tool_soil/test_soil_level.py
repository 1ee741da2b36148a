"""Room of a bucket below the level of the soil before its opening."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.machine_scenes import GRID, excavator

from machine_sim.dem import ParticleEngine, ParticleParams, Pose
from machine_sim.ground.contact_surface import Ground
from machine_sim.tool_soil.bucket_fill import measure_bucket
from msg_bridge.contract.loose_soil import LooseSoil

BUCKET = excavator().bucket
SWELL = 0.25
RNG = np.random.default_rng(0)
_OUT_X, _, _OUT_Z = BUCKET.opening_normal
UPWARD = math.degrees(math.atan2(-_OUT_X, _OUT_Z))
UPRIGHT = UPWARD - 90.0
"""Pitches at which the opening faces upward, and toward -x [deg]."""


def engine(heights: NDArray[np.float64] | float) -> ParticleEngine:
    ground = Ground(GRID, np.broadcast_to(heights, GRID.shape), soils=[LooseSoil(swell=SWELL)])
    return ParticleEngine(ParticleParams(), ground, soils=[LooseSoil(swell=SWELL)])


def room_below_level(particles: ParticleEngine, at: Pose) -> float:
    return measure_bucket(BUCKET, particles, at).room_below_level


def pose(pitch: float, lip: tuple[float, float, float], yaw: float = 0.0) -> Pose:
    """Return the pose with the lip at a point; a pitch of 90 degrees has it straight below the pin,
    and the bucket opens toward -x at a yaw of 0."""
    cp, sp = math.cos(math.radians(pitch)), math.sin(math.radians(pitch))
    cy, sy = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    rotation = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]]
    )
    return rotation, np.array(lip) - rotation @ [BUCKET.tip_radius, 0.0, 0.0]


def counted_room(at: Pose, level: float) -> float:
    """Return the volume in the bucket below a level by counting random points [m^3]."""
    low, high = BUCKET.profile.min(axis=0), BUCKET.profile.max(axis=0)
    count = 200_000
    points = np.zeros((count, 3))
    points[:, [0, 2]] = RNG.uniform(low, high, (count, 2))
    below = (points @ at[0].T + at[1])[:, 2] < level
    share = (BUCKET.contains(points) & below).mean()
    return float(share * np.prod(high - low) * BUCKET.width)


@pytest.mark.parametrize("yaw", [0.0, 37.0, -120.0])
@pytest.mark.parametrize(("pitch", "depth"), [(UPRIGHT, 0.4), (UPRIGHT, 0.8), (70.0, 0.5)])
def test_upright_bucket_fills_up_to_the_ground_before_it(pitch, depth, yaw) -> None:
    at = pose(pitch, (1.0, 2.0, -depth), yaw)
    expected = counted_room(at, 0.0)
    assert 0.01 < expected < 0.9 * BUCKET.struck_capacity
    assert room_below_level(engine(0.0), at) == pytest.approx(expected, rel=0.02)


def test_level_is_that_of_the_berm_and_not_of_the_trench_behind() -> None:
    x, _ = np.meshgrid(GRID.x(np.arange(GRID.rows)), GRID.y(np.arange(GRID.cols)), indexing="ij")
    at = pose(UPRIGHT, (1.0, 2.0, -0.4))
    ahead = (x < 1.0 - 1.5 * GRID.cell) & (x > 1.0 - 2.4 * GRID.cell)
    for behind in (-0.4, 0.5):
        heights = np.where(ahead, 0.3, np.where(x > 1.0 + 0.5 * GRID.cell, behind, 0.0))
        room = room_below_level(engine(heights), at)
        assert room == pytest.approx(counted_room(at, 0.3), rel=0.02)


def test_bucket_that_opens_upward_may_be_heaped_as_far_as_soil_stands_before_it() -> None:
    at = pose(UPWARD, (1.0, 2.0, 0.0))
    assert room_below_level(engine(-1.0), at) == pytest.approx(0.0, abs=1e-9)
    struck = room_below_level(engine(0.0), at)
    assert struck == pytest.approx(BUCKET.struck_capacity, rel=0.01)
    heaped = room_below_level(engine(2.0), at)
    assert heaped >= BUCKET.heaped_capacity
    assert struck < room_below_level(engine(0.2), at) < heaped


def test_soil_in_the_bucket_takes_its_loose_volume() -> None:
    at, particles = pose(UPRIGHT, (1.0, 2.0, -0.8)), engine(0.0)
    empty = room_below_level(particles, at)
    inside = at[0] @ np.array([*BUCKET.profile.mean(axis=0)[[0]], 0.0, 0.4]) + at[1]
    outside = inside - at[0] @ np.array([0.0, 0.0, 1.0])
    for point in (inside, outside):
        particles.add(point[None], np.zeros((1, 3)), np.array([2_000_000], dtype=np.int64))
    assert empty - room_below_level(particles, at) == pytest.approx(2e-3 * (1.0 + SWELL))


def test_bucket_beyond_the_map_has_the_level_of_its_edge() -> None:
    at = pose(UPRIGHT, (1000.0, 2.0, -0.4))
    assert room_below_level(engine(0.0), at) == pytest.approx(counted_room(at, 0.0), rel=0.02)

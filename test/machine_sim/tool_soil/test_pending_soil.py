import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.machine_scenes import GRID, excavator

from machine_sim.dem import ParticleEngine, ParticleError, ParticleParams
from machine_sim.ground.contact_surface import Ground
from machine_sim.reference_cubes import CubeEngine
from machine_sim.tool_soil.pending_soil import PendingSoil, coarse_graining_factor
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows, empty_rows

BUCKET = excavator().bucket
POSE = (np.eye(3), np.array([1.0, 2.0, 3.0]))
NOMINAL = 500_000


def engine() -> ParticleEngine:
    return ParticleEngine(ParticleParams(), Ground(GRID, np.full(GRID.shape, -50.0)))


def pending(max_per_tick: int = 60) -> PendingSoil:
    rng = np.random.default_rng(0)
    return PendingSoil(BUCKET, rng, nominal_mm3=NOMINAL, max_per_tick=max_per_tick)


def parcels(*volumes: int) -> Rows:
    rows = empty_rows(CONVERSION, len(volumes))
    rows["volume_mm3"] = volumes
    rows["row"] = np.arange(len(volumes))
    rows["kind"] = ConversionKind.EXCAVATE
    rows["x"], rows["y"], rows["z"] = 1.7, 2.0, 3.4
    return rows


def test_parcels_of_a_column_accumulate_to_a_particle() -> None:
    soil, particles = pending(), engine()
    soil.receive(parcels(300_000), POSE, 0)
    assert soil.release(particles, POSE, 1) == 0
    soil.receive(parcels(300_000), POSE, 1)
    assert soil.release(particles, POSE, 2) == 1
    assert particles.total_volume_mm3 == NOMINAL
    assert soil.total_mm3 == 100_000


@pytest.mark.parametrize("nominal", [NOMINAL, 4 * NOMINAL])
def test_particles_appear_inside_the_bucket_at_rest_off_its_plates(nominal: int) -> None:
    soil = PendingSoil(BUCKET, np.random.default_rng(0), nominal_mm3=nominal, max_per_tick=60)
    params = ParticleParams(gravity=0.0, nominal_volume=nominal)
    particles = ParticleEngine(params, Ground(GRID, np.full(GRID.shape, -50.0)))
    particles.add_tool(0, BUCKET.plates(), POSE)
    for side in (-1.0, 1.0):  # a column may reach beyond the bucket's side
        rows = parcels(*[nominal] * 3)
        rows["x"], rows["y"] = POSE[1][0] + np.array([0.3, 0.7, 1.1]), POSE[1][1] + side
        rows["row"] += 3 * (side > 0.0)
        soil.receive(rows, POSE, 0)
    assert soil.release(particles, POSE, 1) == 6
    local = particles.positions - POSE[1]
    assert (np.abs(local[:, 1]) <= 0.5 * BUCKET.width - 0.019).all()
    particles.step(0.005)
    # They grow by 0.3 m/s; where they overlapped a plate, it would throw them off at 3 m/s.
    assert np.abs(particles.velocities).max() < 0.7


def test_particles_are_released_into_a_bucket_hardly_larger_than_they_are() -> None:
    small = dataclasses.replace(BUCKET, profile=0.1 * BUCKET.profile, width=0.1)
    soil = PendingSoil(small, np.random.default_rng(0), nominal_mm3=NOMINAL, max_per_tick=60)
    soil.receive(parcels(NOMINAL), POSE, 0)
    assert soil.release(engine(), POSE, 1) == 1


def test_pending_soil_moves_with_the_tool() -> None:
    soil, particles = pending(), engine()
    soil.receive(parcels(NOMINAL), POSE, 0)
    soil.release(particles, (np.eye(3), POSE[1] + [0.0, 0.0, 5.0]), 1)
    assert particles.positions[0, 2] > 7.5


def test_release_is_limited_per_tick() -> None:
    soil, particles = pending(max_per_tick=4), engine()
    soil.receive(parcels(10 * NOMINAL), POSE, 0)
    assert soil.release(particles, POSE, 1) == 4
    assert soil.total_mm3 == 6 * NOMINAL
    assert soil.release(particles, POSE, 2) == 4


def test_remainders_of_idle_columns_are_merged_to_particles() -> None:
    soil, particles = pending(), engine()
    soil.receive(parcels(*[90_000] * 6), POSE, 0)
    for tick in range(1, 10):
        soil.release(particles, POSE, tick)
    assert particles.count >= 1
    assert particles.total_volume_mm3 + soil.total_mm3 == 6 * 90_000
    assert soil.total_mm3 < NOMINAL / 4
    assert particles.volumes_mm3.max() < 1.25 * NOMINAL


@pytest.mark.parametrize(
    ("volumes", "soils", "expected"),
    [
        ((100_000, 30_000), (1, 0), 1),
        ((30_000, 100_000), (1, 0), 0),
        ((100_000, NOMINAL, 30_000), (1, 0, 2), 1),  # of the second column nothing is left
    ],
)
def test_remainder_of_several_soils_has_the_kind_of_its_larger_part(
    volumes: tuple[int, ...], soils: tuple[int, ...], expected: int
) -> None:
    ground = Ground(GRID, np.full(GRID.shape, -50.0))
    soil = pending()
    particles = ParticleEngine(ParticleParams(), ground, soils=[LooseSoil()] * 3)
    rows = parcels(*volumes)
    rows["soil"] = soils
    soil.receive(rows, POSE, 0)
    for tick in range(1, 10):
        soil.release(particles, POSE, tick)
    assert particles.volumes_mm3.tolist()[-1] == 130_000
    assert particles.soil.tolist()[-1] == expected
    assert soil.total_mm3 == 0


def test_remainder_stays_where_it_was_when_a_column_without_a_rest_ends() -> None:
    soil, particles = pending(max_per_tick=1), engine()
    rows = parcels(NOMINAL, 130_000, NOMINAL)
    rows["x"] = POSE[1][0] + np.array([0.5, 0.7, 1.1])
    soil.receive(rows, POSE, 0)
    for tick in range(1, 8):
        if tick == 6:  # the only particle of the tick in which the two other columns are merged
            soil.receive(rows[:1], POSE, tick)
        soil.release(particles, POSE, tick)
    assert particles.volumes_mm3.tolist() == [NOMINAL, NOMINAL, NOMINAL, 130_000]
    assert particles.positions[3, 0] == pytest.approx(POSE[1][0] + 0.7, abs=0.03)


@pytest.mark.parametrize("volume", [90_000, 499_000])
def test_soil_held_back_by_a_full_engine_is_released_in_normal_sizes(volume: int) -> None:
    params = ParticleParams(capacity=1000)
    particles = ParticleEngine(params, Ground(GRID, np.full(GRID.shape, -50.0)))
    ids = particles.add(np.zeros((1000, 3)), np.zeros((1000, 3)), NOMINAL)
    soil, total = pending(max_per_tick=20), 9000 * volume
    soil.receive(parcels(*[volume] * 9000), POSE, 0)
    for tick in range(1, 10):
        assert soil.release(particles, POSE, tick) == 0
    assert soil.total_mm3 == total
    particles.remove(ids)
    for tick in range(10, 1000):
        before, old_ids = particles.count, particles.ids.copy()
        made = soil.release(particles, POSE, tick)
        assert made <= 20
        new = particles.volumes_mm3[~np.isin(particles.ids, old_ids)]
        assert (new < (coarse_graining_factor(before + made, 1000) + 0.25) * NOMINAL).all()
        assert soil.total_mm3 + particles.total_volume_mm3 == total
        if particles.free_capacity == 0:  # everything in it is deposited
            particles.remove(particles.ids)
            total = soil.total_mm3
    assert soil.total_mm3 < NOMINAL / 4


def test_soil_rejected_by_the_engine_stays_pending() -> None:
    soil, particles = pending(), engine()
    rows = parcels(*[5 * NOMINAL // 2] * 4)
    rows["moisture"] = (7, 20, 33, 50)
    soil.receive(rows, POSE, 0)
    lost = (np.eye(3), np.array([np.nan, 0.0, 0.0]))
    for tick in (1, 10):
        with pytest.raises(ParticleError):
            soil.release(particles, lost, tick)
        assert soil.total_mm3 == 10 * NOMINAL
        assert soil.accounted_water == water_in(rows)
    soil.release(particles, POSE, 11)
    assert particles.count == 10
    carried = int((particles.volumes_mm3 * particles.moisture.astype(np.int64)).sum())
    assert soil.accounted_water + carried == water_in(rows)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.lists(st.integers(1, 3_000_000), max_size=6), max_size=15))
def test_no_volume_is_lost_between_parcels_and_particles(ticks: list[list[int]]) -> None:
    soil, particles = pending(max_per_tick=5), engine()
    total = 0
    for tick, volumes in enumerate(ticks):
        soil.receive(parcels(*volumes), POSE, tick)
        total += sum(volumes)
        soil.release(particles, POSE, tick)
        assert soil.total_mm3 + particles.total_volume_mm3 == total


def test_particles_of_one_point_are_scattered() -> None:
    soil, particles = pending(), engine()
    soil.receive(parcels(8 * NOMINAL), POSE, 0)
    soil.release(particles, POSE, 1)
    position = particles.positions
    assert np.unique(position.round(4), axis=0).shape[0] == 8
    assert position.std(axis=0) == pytest.approx(0.045, abs=0.04)


def test_particle_sizes_vary_by_the_size_spread() -> None:
    soil = pending(max_per_tick=1000)
    particles = ParticleEngine(
        ParticleParams(),
        Ground(GRID, np.full(GRID.shape, -50.0)),
        soils=[LooseSoil(size_spread=0.5)],
    )
    soil.receive(parcels(200 * NOMINAL), POSE, 0)
    soil.release(particles, POSE, 1)
    volumes = particles.volumes_mm3
    assert volumes.min() < 0.6 * NOMINAL
    assert volumes.max() > 1.4 * NOMINAL
    assert volumes.mean() == pytest.approx(NOMINAL, rel=0.1)
    assert soil.total_mm3 + particles.total_volume_mm3 == 200 * NOMINAL


def water_in(rows: Rows) -> int:
    """Volume times moisture of rows [mm^3 %]."""
    return int((rows["volume_mm3"].astype(np.int64) * rows["moisture"]).sum())


@pytest.mark.parametrize("engine_of", [ParticleEngine, CubeEngine])
def test_particles_have_the_moisture_of_the_excavated_soil(engine_of) -> None:
    soil = pending()
    particles = engine_of(
        ParticleParams(), Ground(GRID, np.full(GRID.shape, -50.0)), soils=[LooseSoil(moisture=40)]
    )
    rows = parcels(NOMINAL, NOMINAL, 3 * NOMINAL)
    rows["moisture"] = (0, 100, 63)
    soil.receive(rows, POSE, 0)
    soil.release(particles, POSE, 1)
    assert particles.moisture.tolist() == [0, 100, 63, 63, 63]
    particles.close()


def test_contact_parameters_follow_the_moisture() -> None:
    soil = pending()
    kind = LooseSoil(
        repose_angles=(35.0, 40.0, 22.0),
        cohesion=8000.0,
        adhesion=1000.0,
        moisture_strength_factors=(1.0, 1.5, 0.5),
    )
    ground = Ground(GRID, np.full(GRID.shape, -50.0))
    particles = ParticleEngine(ParticleParams(), ground, soils=[kind])
    rows = parcels(NOMINAL, NOMINAL)
    rows["moisture"] = (0, 50)
    soil.receive(rows, POSE, 0)
    soil.release(particles, POSE, 1)
    dry, damp = particles.contact_coefficients.cohesion.tolist()
    assert damp == pytest.approx(1.5 * dry)
    assert particles.contact_coefficients.adhesion[1] == pytest.approx(
        1.5 * particles.contact_coefficients.adhesion[0]
    )
    assert (
        particles.contact_coefficients.rolling_friction[1]
        > particles.contact_coefficients.rolling_friction[0]
    ), "moist soil has a larger angle of repose"


def test_moisture_of_merged_parcels_is_weighted_by_volume() -> None:
    soil, particles = pending(), engine()
    for volume, moisture in ((NOMINAL // 4, 80), (NOMINAL - NOMINAL // 4, 20)):
        rows = parcels(volume)
        rows["moisture"] = moisture
        soil.receive(rows, POSE, 0)
    soil.release(particles, POSE, 1)
    assert particles.moisture.tolist() == [35]


PARCEL = st.tuples(st.integers(1, 3_000_000), st.integers(0, 100), st.integers(0, 3))
"""Volume [mm^3], moisture [%], column."""


@settings(deadline=None, max_examples=40)
@given(st.lists(st.lists(PARCEL, max_size=6), max_size=15))
def test_no_water_is_lost_between_parcels_and_particles(
    ticks: list[list[tuple[int, int, int]]],
) -> None:
    soil = pending(max_per_tick=5)
    ground = Ground(GRID, np.full(GRID.shape, -50.0))
    particles = ParticleEngine(ParticleParams(), ground, soils=[LooseSoil(size_spread=0.5)])
    given_water, largest = 0, 0
    for tick, volumes in enumerate(ticks):
        rows = parcels(*(volume for volume, _, _ in volumes))
        rows["moisture"] = [moisture for _, moisture, _ in volumes]
        rows["row"] = [column for _, _, column in volumes]
        soil.receive(rows, POSE, tick)
        given_water += water_in(rows)
        soil.release(particles, POSE, tick)
        carried = int((particles.volumes_mm3 * particles.moisture.astype(np.int64)).sum())
        assert soil.accounted_water + carried == given_water
        largest = max([largest, *particles.volumes_mm3.tolist()])
        assert abs(soil.rounding_error) <= largest / 2
        seen = [moisture for each in ticks for _, moisture, _ in each]
        assert all(min(seen) <= moisture <= max(seen) for moisture in particles.moisture)


@settings(deadline=None, max_examples=20)
@given(st.lists(st.lists(st.integers(1, 3_000_000), max_size=6), max_size=15), st.integers(0, 100))
def test_soil_of_one_moisture_keeps_it(ticks: list[list[int]], moisture: int) -> None:
    soil, particles = pending(max_per_tick=5), engine()
    for tick, volumes in enumerate(ticks):
        rows = parcels(*volumes)
        rows["moisture"] = moisture
        soil.receive(rows, POSE, tick)
        soil.release(particles, POSE, tick)
    assert set(particles.moisture.tolist()) <= {moisture}
    assert soil.accounted_water == moisture * soil.total_mm3


def test_particles_get_coarser_as_the_engine_fills() -> None:
    soil = pending(max_per_tick=1000)
    params = ParticleParams(capacity=40)
    particles = ParticleEngine(params, Ground(GRID, np.full(GRID.shape, -50.0)))
    given = 400 * NOMINAL
    soil.receive(parcels(*[4 * NOMINAL] * 100), POSE, 0)
    for tick in range(1, 30):
        soil.release(particles, POSE, tick)
        soil.receive(parcels(*[2 * NOMINAL] * 100), POSE, tick)
        given += 200 * NOMINAL
    assert particles.count == 40
    assert particles.volumes_mm3.max() > 3 * NOMINAL
    assert particles.volumes_mm3.max() < 8.25 * NOMINAL
    assert soil.total_mm3 + particles.total_volume_mm3 == given
    assert coarse_graining_factor(10, 40) == 1.0
    assert coarse_graining_factor(40, 40) == 8.0
    for tick in range(30, 400):
        particles.remove(particles.ids[:5])
        soil.release(particles, POSE, tick)
        assert (particles.volumes_mm3 < 8.25 * NOMINAL).all()
    assert soil.total_mm3 < NOMINAL / 4

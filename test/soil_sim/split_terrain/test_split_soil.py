"""A terrain split among regions loses no volume at their borders, and is shaped as one soil is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
import pytest
from support.node_scenes import drag_velocities, ready_to_dig
from support.soil_scenes import NO_DEPOSIT_REQUESTS, NO_SWEEPS, bucket_sweep, make_deposit_requests

from earthmoving_sim.world import World
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soils.params import SoilParams
from soil_sim.split_terrain import SplitSoil
from soil_sim.split_terrain.border_link import Channel

GRID = Grid(96, 48, 0.1)
HALO = 24
ROOM = 4_000_000
"""Bank volume that the bucket takes in in a tick: it pushes a berm ahead [mm^3]."""


def split(heights: np.ndarray, params: SoilParams, **options: object) -> SplitSoil:
    """Return a terrain of two regions."""
    return SplitSoil(GRID, heights, params, num_regions=2, halo=HALO, **options)  # type: ignore[arg-type]


def step_exactly(
    soil: Soil | SplitSoil,
    tick: int,
    sweeps: Rows = NO_SWEEPS,
    requests: Rows = NO_DEPOSIT_REQUESTS,
) -> SoilStepResult:
    """Step a soil, and check that it changes by exactly the volume of the conversions."""
    before = soil.total_mm3
    step = soil.step(tick, sweeps, requests)
    kinds, volumes = step.conversions["kind"], step.conversions["volume_mm3"].astype(np.int64)
    assert soil.total_mm3 - before == volumes[kinds == 1].sum() - volumes[kinds == 0].sum()
    return step


def step_until_at_rest(soil: Soil | SplitSoil, tick: int) -> None:
    """Step until no column waits for relaxation and nothing is in flight, three ticks at least."""
    for number in range(1000):
        step_exactly(soil, tick + number)
        pending = soil.num_pending if isinstance(soil, SplitSoil) else soil.relaxation.num_pending
        if number > 2 and not pending:
            assert soil.verify_volume()
            return
    raise AssertionError("the soil does not come to rest")


def drag(soil: Soil | SplitSoil) -> tuple[int, list[float]]:
    """Drag a bucket along x over the border; return the excavated volume and the forces [N]."""
    excavated, forces = 0, []
    path = [(x, 0.0, -0.3) for x in np.arange(-2.0, 2.0, 0.02)]
    for tick, (start, end) in enumerate(pairwise(path)):
        sweep = bucket_sweep(start, end)
        sweep["room_mm3"] = ROOM
        step = step_exactly(soil, tick, sweep)
        excavated += int(step.conversions["volume_mm3"].sum(dtype=np.int64))
        forces.append(float(np.hypot(step.forces["fx"].sum(), step.forces["fz"].sum())))
    step_until_at_rest(soil, len(path))
    return excavated, forces


@pytest.mark.parametrize("name", ["dry sand", "loam"])
def test_bucket_digs_over_the_border_as_in_one_soil(name: str) -> None:
    params, level = SoilParams(soil=name), np.zeros(GRID.shape)
    one, two = Soil(GRID, level, params), split(level, params)
    (expected, expected_forces), (excavated, forces) = drag(one), drag(two)
    assert excavated == pytest.approx(expected, rel=0.02)
    assert two.in_flight_mm3 == 0
    difference = two.columns.height - one.columns.height
    assert difference.std() < 0.01
    assert np.abs(difference).max() < 0.2
    ratios = np.array(forces[20:]) / np.array(expected_forces[20:])
    assert np.median(ratios) == pytest.approx(1.0, abs=0.03)
    assert 0.5 < ratios.min() < ratios.max() < 2.0


def test_heap_on_the_border_is_a_cone() -> None:
    params, level = SoilParams(soil="dry sand"), np.zeros(GRID.shape)
    one, two = Soil(GRID, level, params), split(level, params)
    for soil in (one, two):
        for tick in range(60):
            requests = make_deposit_requests([0.03] * 4, 0.0, 5_000_000)
            step_exactly(soil, tick, requests=requests)
        step_until_at_rest(soil, 60)
    volumes = [region.own_mm3 - before for region, before in _with_level_volume(two, level, params)]
    assert sum(volumes) == 60 * 4 * 5_000_000
    assert min(volumes) > 0.4 * sum(volumes)
    assert np.abs(two.columns.height - one.columns.height).max() < 0.06


def _with_level_volume(soil: SplitSoil, level: np.ndarray, params: SoilParams):
    """Return each region with the volume that it has on level ground [mm^3]."""
    return zip(soil.regions, [each.own_mm3 for each in split(level, params).regions], strict=True)


def test_bank_that_fails_over_the_border_keeps_its_volume() -> None:
    params = SoilParams(soil="loam")
    bank = np.zeros(GRID.shape)
    bank[GRID.x(np.arange(GRID.rows)) > 0.35] = 6.0  # its toe is beside the border
    one, two = Soil(GRID, bank, params), split(bank, params)
    one.relaxation.mark_all_disturbed()
    for region in two.regions:
        region.soil.relaxation.mark_all_disturbed()
    crossed = 0
    for soil in (one, two):
        for tick in range(100):
            step_exactly(soil, tick)
            crossed += soil.in_flight_mm3 if isinstance(soil, SplitSoil) else 0
        step_until_at_rest(soil, 100)
    assert crossed > 1_000_000_000
    fallen, expected = (np.maximum(bank - each.columns.height, 0.0).sum() for each in (two, one))
    assert fallen == pytest.approx(expected, rel=0.2)


class LossyChannel:
    """Loses, repeats and reorders parts of what is sent."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def __call__(self, rows: Rows) -> Iterable[Rows]:
        parts = [each for each in np.array_split(rows, 4) if self._rng.uniform() > 0.3]
        parts += [each for each in parts if self._rng.uniform() < 0.3]
        self._rng.shuffle(parts)  # type: ignore[arg-type]
        return parts


def _lossy_channels() -> Callable[[], Channel]:
    seeds = iter(range(100))
    return lambda: LossyChannel(next(seeds))


def test_lossy_links_change_nothing() -> None:
    params, level = SoilParams(soil="dry sand"), np.zeros(GRID.shape)
    lossless, lossy = split(level, params), split(level, params, make_channel=_lossy_channels())
    assert drag(lossy) == drag(lossless)
    assert lossy.state_hash() == lossless.state_hash()


def test_machine_digs_on_the_border_over_the_exchange() -> None:
    machine, grid = ready_to_dig(), Grid(128, 96, 0.15)
    soil = SplitSoil(grid, np.zeros(grid.shape), SoilParams(), num_regions=2, halo=HALO)
    sim = MachineSim(
        [Placement(machine, (-6.3, 0.0))],
        grid,
        soil.columns.height,
        soils=soil.loose_soils,
    )
    world = World(soil, {1: sim})  # type: ignore[arg-type]
    before = [region.own_mm3 for region in soil.regions]
    for tick in range(300):
        command = drag_velocities(machine, tick, 250)
        sim.command(command[:4], 0.0 * command[4:])
        ledger = world.step()
        assert ledger.imbalance == 0
        assert ledger.terrain == soil.total_mm3
    removed = [now - region.own_mm3 for now, region in zip(before, soil.regions, strict=True)]
    assert min(removed) > 20_000_000
    assert sim.particles.count > 0
    assert soil.verify_volume()
    world.close()


def test_regions_narrower_than_the_halo_are_rejected() -> None:
    with pytest.raises(ParameterError, match="fewer regions, or reduce the halo"):
        SplitSoil(GRID, np.zeros(GRID.shape), num_regions=8, halo=HALO)

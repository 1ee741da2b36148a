"""Random input on random ground: volume is exact, slopes come to rest, runs are reproducible."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.soil_scenes import NO_DEPOSIT_REQUESTS, NO_SWEEPS, bucket_sweep, make_deposit_requests

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    UNLIMITED_ROOM,
    ConversionKind,
    Rows,
    SoilReaction,
    SweepAction,
)
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import load_soil_types

NAMES = tuple(load_soil_types())
MAX_VISITS_TO_REST = 3 * 10**7
TICKS = 15
RELAXATION_TICKS = 50


@dataclass(frozen=True)
class Site:
    """Ground to work on: a grid, soils by name ("" for angle and swell), and a seed."""

    grid: Grid
    params: SoilParams
    seed: int

    def create_soil(self) -> Soil:
        """Return hilly ground of one or several soils and moistures, with all slopes to relax."""
        rng = np.random.default_rng(self.seed)
        shape, cell = self.grid.shape, self.grid.cell
        steps = np.cumsum(rng.normal(0.0, 0.3 * cell, shape), axis=0)
        heights = steps + np.cumsum(rng.normal(0.0, 0.3 * cell, shape), axis=1)
        heights[rng.random(shape) < 0.02] += rng.uniform(-1.0, 2.0)  # pillars and holes
        kinds = 1 + len(self.params.additional_soils)
        ids = np.kron(rng.integers(0, kinds, (18, 18)), np.ones((4, 4)))
        layers = {
            "soil": ids[: shape[0], : shape[1]].astype(np.uint8),
            "moisture": rng.integers(0, MOISTURE_LEVELS, shape),
        }
        for name in list(layers):
            if rng.random() < 0.4:
                del layers[name]
        soil = Soil(self.grid, heights, self.params, **layers)  # type: ignore[arg-type]
        soil.relaxation.mark_all_disturbed()
        return soil


@st.composite
def sites(draw: st.DrawFn) -> Site:
    name = draw(st.sampled_from(("", *NAMES)))
    plain: dict[str, Any] = {
        "repose_angle": draw(st.floats(10.0, 60.0)),
        "swell": draw(st.floats(0.0, 0.7)),
    }
    params = SoilParams(
        soil=name,
        additional_soils=tuple(draw(st.lists(st.sampled_from(NAMES), max_size=3))),
        moisture=draw(st.sampled_from((-1, 0, 37, 100))),
        relaxation_radius=draw(st.sampled_from((1.0, 1.5, 2.3, 4.0, 4.0, 4.0))),
        max_cell_visits_per_tick=draw(st.sampled_from((100, 20_000))),
        soil_depth=draw(st.sampled_from((0.3, 5.0))),
        cut_mode=draw(st.sampled_from(("swept", "reference"))),
        repose_angle_noise=draw(st.sampled_from((0.0, 0.0, 4.0))),
        redistribution_noise=draw(st.sampled_from((0.0, 0.0, 0.5))),
        surface_tilt_noise=draw(st.sampled_from((0.0, 20.0))),
        **({} if name else plain),
    )
    # Above 2000 columns large failures are relaxed in windows.
    side = st.integers(2, 30) if draw(st.booleans()) else st.integers(48, 72)
    grid = Grid(draw(side), draw(side), draw(st.sampled_from((0.05, 0.1, 0.25, 0.4))))
    return Site(grid, params, draw(st.integers(0, 2**32 - 1)))


def random_input(soil: Soil, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Return the input of a tick: a bucket that cuts or compacts, particles on and off the map."""
    size = np.array([*soil.grid.size, 2.0])
    top = float(soil.columns.height.max())
    sweep, deposit_requests = NO_SWEEPS, NO_DEPOSIT_REQUESTS
    if rng.random() < 0.6:
        start = rng.uniform(-0.55, 0.55, 3) * size + (0.0, 0.0, top)
        end = start + rng.normal(0.0, 1.0, 3) * (0.4, 0.4, 0.2)
        sweep = bucket_sweep(tuple(start), tuple(end), width=float(rng.uniform(0.05, 1.5)))
        sweep["room_mm3"] = rng.choice([0, 10**6, 10**8, UNLIMITED_ROOM])
        if rng.random() < 0.3:
            sweep["action"] = SweepAction.COMPACT
    if rng.random() < 0.8:
        count = int(rng.integers(1, 30))
        positions = (
            rng.uniform(-0.52, 0.52, (2, 1 if rng.random() < 0.3 else count)) * size[:2, None]
        )
        max_mm3 = soil.grid.cell**2 * rng.choice([1e6, 1e8, 4e8])  # up to 0.4 m in one column
        x, y = np.broadcast_to(positions, (2, count))
        deposit_requests = make_deposit_requests(x, y, 1)
        deposit_requests["volume_mm3"] = rng.integers(1, int(max_mm3), count)
        deposit_requests["soil"] = rng.integers(0, len(soil.soil_types), count)
        deposit_requests["moisture"] = rng.integers(0, MOISTURE_LEVELS, count)
    if rng.random() < 0.3:
        sweep, deposit_requests = corrupt(sweep, rng), corrupt(deposit_requests, rng)
    return sweep, deposit_requests


def corrupt(rows: Rows, rng: np.random.Generator) -> Rows:
    """Return rows with random bits in fields, or with rows removed, duplicated or shuffled."""
    rows = rows.copy()
    for _ in range(rng.integers(1, 5)):
        if rows.size == 0:
            break
        row, name = rng.integers(rows.size), str(rng.choice(rows.dtype.names or ()))
        change = rng.integers(4)
        if change == 0:
            field = rows[name][row : row + 1].view(np.uint8)
            field[:] = rng.integers(0, 256, field.size)
        elif change == 1 and name in ("x", "y", "z", "x0", "y0", "z0", "x1", "y1", "z1"):
            rows[name][row] = rng.choice([np.nan, np.inf, -np.inf, 1e18, -1e18, 3e38, 1e5, -30.0])
        elif change == 2:
            rows = np.delete(rows, row)
        else:
            rows = rows[rng.integers(0, rows.size, rows.size)]
    return rows


def state(soil: Soil) -> NDArray[np.int64]:
    """Return firm, loose and bulk volume [mm^3], kind and moisture on top: (5, rows, cols)."""
    columns = soil.columns
    top = (columns.top_soil.astype(np.int64), columns.top_moisture.astype(np.int64))
    return np.stack([columns.firm, columns.loose, columns.bulk, *top])


def check_invariants(soil: Soil) -> None:
    """Assert that volumes are valid, and that the surface has the height of the volumes."""
    columns = soil.columns
    assert columns.firm.min() >= 0
    assert columns.loose.min() >= 0
    assert (columns.bulk >= columns.loose).all(), "loose soil is never denser than bank soil"
    assert (columns.bulk[columns.loose == 0] == 0).all()
    assert columns.moisture.max() < MOISTURE_LEVELS
    assert columns.top_soil.max() < len(soil.soil_types)
    surface = columns.floor + (columns.firm + columns.bulk) * columns.metres_per_mm3
    assert columns.height == pytest.approx(surface, abs=1e-9)
    assert soil.verify_volume()


def check_step_result(
    soil: Soil,
    before: NDArray[np.int64],
    step: SoilStepResult,
    deposit_requests: Rows,
    sweeps: Rows,
) -> None:
    """Assert that conversions, map updates and rejections agree with the change of state."""
    after = state(soil)
    volume = step.conversions["volume_mm3"].astype(np.int64)
    kind = step.conversions["kind"]
    deposited = int(volume[kind == ConversionKind.DEPOSIT].sum())
    excavated = int(volume[kind == ConversionKind.EXCAVATE].sum())
    assert int(after[:2].sum()) + excavated - deposited == int(before[:2].sum())
    assert (kind != ConversionKind.EXCAVATE).sum() == deposit_requests.size
    cuts = (step.forces["reaction"] == SoilReaction.CUT).sum()
    assert cuts + len(step.rejected_tools) == np.unique(sweeps[["machine_id", "tool"]]).size

    is_updated = np.zeros(soil.grid.shape, dtype=bool)
    is_updated[step.map_updates["row"], step.map_updates["col"]] = True
    assert is_updated.sum() == step.map_updates.size, "no duplicates"
    assert np.array_equal(is_updated, (before != after).any(axis=0))
    assert np.array_equal(step.map_updates["volume_mm3"], after[:2].sum(axis=0)[is_updated])
    assert step.map_updates["z"] == pytest.approx(
        soil.columns.height[is_updated], abs=1e-5, rel=1e-6
    )
    assert np.array_equal(step.map_updates["soil"], soil.columns.top_soil[is_updated])
    assert np.array_equal(step.map_updates["moisture"], soil.columns.top_moisture[is_updated])
    depth = soil.columns.loose_depth[is_updated]
    assert step.map_updates["loose_depth"] == pytest.approx(depth, abs=1e-5, rel=1e-6)


def run_twice(site: Site) -> None:
    """Run a site twice, check it once, and compare the states of the two runs."""
    hashes = []
    for is_checked in (True, False):
        soil, rng = site.create_soil(), np.random.default_rng(site.seed)
        states = hashlib.sha256()
        for tick in range(TICKS):
            before = state(soil)
            sweeps, deposit_requests = random_input(soil, rng)
            step = soil.step(tick, sweeps, deposit_requests)
            if is_checked:
                check_invariants(soil)
                check_step_result(soil, before, step, deposit_requests, sweeps)
            states.update(soil.state_hash().encode())
        total = soil.total_mm3
        # Without tools all columns are free to relax, within the budget of each tick. The smaller
        # budget would take too many ticks, so after some of them the rest is relaxed at once.
        for _ in range(RELAXATION_TICKS):
            soil.step(TICKS, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        soil.relaxation.relax(MAX_VISITS_TO_REST)
        # Volume and state hash include changes between steps only after the next step.
        soil.step(TICKS, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        assert soil.relaxation.num_pending == 0
        assert soil.relaxation.max_slope_excess() <= 2 * soil.params.relaxation_tolerance
        assert soil.total_mm3 == total
        check_invariants(soil)
        states.update(soil.state_hash().encode())
        hashes.append(states.hexdigest())
    assert hashes[0] == hashes[1]


@settings(deadline=None, max_examples=20)
@given(site=sites())
def test_random_input_keeps_volume_and_slopes_come_to_rest(site: Site) -> None:
    run_twice(site)


def test_columns_that_a_window_has_left_are_checked_once() -> None:
    """Else a window in which nothing moves is relaxed again and again."""
    params = SoilParams(soil="dry clay", additional_soils=("gravel",))
    soil = Site(Grid(48, 48, 0.05), params, seed=48).create_soil()
    soil.relaxation.relax(10**6)
    assert soil.relaxation.num_pending == 0


@pytest.mark.slow
@pytest.mark.independent
@settings(deadline=None, max_examples=150)
@given(site=sites())
def test_many_random_inputs_keep_volume_and_slopes_come_to_rest(site: Site) -> None:
    run_twice(site)

"""Site of the soil run: its design, cut and fill, and what a reset restores."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.soil_scenes import bucket_sweep, flat_soil
from support.soil_timeline import Timeline

from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import SoilRun
from soil_sim.site.cut_fill import compare_to_design
from soil_sim.site.design import DesignSurface
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import Layers, flat


def site_with_design(depth: float) -> Site:
    """Return level ground with a design that has a pit in the middle and is NaN elsewhere."""
    grid = flat_soil().grid
    heights = np.full(grid.shape, np.nan)
    heights[20:40, 20:40] = -depth
    return Site(flat(grid), design=DesignSurface(grid, heights))


def dig(time: Timeline, ticks: int) -> None:
    """Drag a bucket through the pit of the design."""
    x = 0.02 * np.arange(ticks + 1) - 0.5
    for a, b in pairwise(x.tolist()):
        time.send(1, bucket_sweep((a, 0.0, -0.3), (b, 0.0, -0.3)))
        assert time.ticks() == 1


def test_run_without_design_has_no_cut_and_fill() -> None:
    assert Timeline().run.cut_fill is None


def test_cut_and_fill_are_updated_exactly_without_comparing_the_whole_design_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    site, comparisons = site_with_design(0.5), []
    monkeypatch.setattr(
        "soil_sim.site.site.compare_to_design",
        lambda *a, **k: comparisons.append(1) or compare_to_design(*a, **k),
    )
    time = Timeline(1, site=site, sync="lockstep")
    assert time.run.cut_fill is not None
    assert time.run.cut_fill.cut == pytest.approx(400 * 0.04 * 0.5)
    for _ in range(3):
        before = time.run.cut_fill.cut_mm3
        dig(time, 10)
        assert time.run.cut_fill.cut_mm3 < before
        assert site.design is not None
        expected = compare_to_design(site.design, time.run.endpoint.soil.columns.height)
        now = time.run.cut_fill
        assert (now.cut_mm3, now.fill_mm3) == (expected.cut_mm3, expected.fill_mm3)
        assert now.within_tolerance == expected.within_tolerance
        assert np.array_equal(now.difference, expected.difference, equal_nan=True)
    assert len(comparisons) == 1


def test_reset_restores_the_cut_volume() -> None:
    time = Timeline(1, site=site_with_design(0.5), sync="lockstep")
    assert time.run.cut_fill is not None
    initial = time.run.cut_fill.cut_mm3
    dig(time, 20)
    assert time.run.cut_fill.cut_mm3 < initial
    time.run.reset()
    assert time.run.cut_fill.cut_mm3 == initial


def test_reset_restores_the_layers_of_the_site() -> None:
    grid = flat_soil().grid
    ids = np.ones(grid.shape, dtype=np.uint8)
    moisture = np.full(grid.shape, 37, dtype=np.uint8)
    site = Site(flat(grid), Layers(ids, moisture))
    soil = SoilParams(additional_soils=("dry clay",))
    run = SoilRun(site, soil, SoilNodeParams(expected_machines=()), run_id=7)
    for _ in range(2):
        columns = run.endpoint.soil.columns
        assert (columns.soil == 1).all()
        assert (columns.moisture == 37).all()
        columns.soil[:], columns.moisture[:] = 0, 0
        run.reset()

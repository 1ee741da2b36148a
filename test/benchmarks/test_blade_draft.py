"""Draft force of blades beside measured ones, and beside those in a bed of spheres."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blade_draft.blade import SPEED, Blade
from benchmarks.blade_draft.chart import draw_chart
from benchmarks.blade_draft.measured import SANDS, BladeTest, Draft, read_tests, simulate
from benchmarks.blade_draft.resolved import ResolvedDrag, read_drags, simulate_drag
from benchmarks.blade_draft.sphere_drag import drag_in_spheres, write_input
from benchmarks.liggghts_runner import is_installed

DRY = SANDS[0]


@pytest.fixture(scope="module")
def drafts() -> list[Draft]:
    return [simulate(test, (0.05,)) for test in read_tests()]


def test_sand_without_cohesion_resists_as_measured(drafts: list[Draft]) -> None:
    """The bounds are those of docs/validation.md: blades as deep as wide are the worst."""
    ratios = np.array([draft.ratio(DRY) for draft in drafts])
    shallow = np.array([draft.test.depth < 0.8 * draft.test.width for draft in drafts])
    assert ratios[shallow].mean() == pytest.approx(1.0, abs=0.25)
    assert ratios.min() > 0.6
    assert ratios.max() < 1.8


def test_wider_and_deeper_blades_resist_more(drafts: list[Draft]) -> None:
    forces = np.reshape([draft.forces[DRY][0] for draft in drafts], (2, 4))
    assert (np.diff(forces, axis=0) > 0.0).all()
    assert (np.diff(forces, axis=1) > 0.0).all()


@pytest.mark.parametrize("drag", read_drags(), ids=lambda drag: str(drag.blade))
def test_blade_resists_as_in_spheres(drag: ResolvedDrag) -> None:
    """The bounds are those of docs/validation.md; the lift of upright blades is the worst."""
    ours, spheres = (np.array(each.forces) for each in (simulate_drag(drag.blade), drag))
    assert 1.0 < (ours[:, 0] / spheres[:, 0]).mean() < 1.7
    lift = ours[1:, 1] / ours[1:, 0]
    assert lift == pytest.approx(spheres[1:, 1] / spheres[1:, 0], abs=0.32)


def test_chart_is_drawn(tmp_path: Path) -> None:
    forces = dict.fromkeys(SANDS, (300.0, 310.0))
    drag = ResolvedDrag(Blade(0.2, 0.2, 90.0, "spheres"), [(500.0, 100.0)] * 5)
    drafts = [Draft(BladeTest(0.2, 0.1, 280.0, 35.0), forces)]
    draw_chart(tmp_path / "draft.png", drafts, [(drag, drag)])
    assert (tmp_path / "draft.png").stat().st_size > 0


def test_blade_in_liggghts_moves_through_the_bed_at_its_depth(tmp_path: Path) -> None:
    width, depth, travel = 0.3, 0.2, 0.15
    blade = Blade(width, depth, 60.0, "")
    assert write_input(blade, 20.0, travel, 0.04, tmp_path) == width
    corners = re.findall(r"vertex (\S+) (\S+) (\S+)", (tmp_path / "tool.stl").read_text())
    x, y, z = np.array(corners, dtype=float).T
    assert z.min() == pytest.approx(-depth)
    assert np.ptp(y) == pytest.approx(width, abs=1e-5)
    assert np.ptp(z) / np.ptp(x) == pytest.approx(math.tan(math.radians(blade.rake)))
    script = (tmp_path / "in.txt").read_text()
    timestep = float(re.findall(r"timestep (\S+)", script)[0])
    steps = int(re.findall(r"run (\d+)", script)[-1])
    assert SPEED * timestep * steps == pytest.approx(travel)
    assert f"linear {SPEED} 0. 0." in script


@pytest.mark.skipif(not is_installed(), reason="LIGGGHTS is not installed")
def test_blade_in_liggghts_is_resisted(tmp_path: Path) -> None:
    drag = drag_in_spheres(Blade(math.inf, 0.2, 90.0, ""), 20.0, 0.15, 0.04, tmp_path)
    assert drag.travel[-1] == pytest.approx(0.15)
    assert drag.mean(0.05, 0.15)[0] > 500.0

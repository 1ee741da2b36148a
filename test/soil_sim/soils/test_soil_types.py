"""Kinds of soil: shipped file, moisture, mixing, stability, compaction and surface material."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    bucket_sweep,
    make_deposit_requests,
    reference_soil,
)

from msg_bridge.config_files import ConfigError
from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from soil_sim.columns.operations import add_loose, compact_loose, remove_loose
from soil_sim.columns.state import Columns, SurfaceMaterial
from soil_sim.errors import SoilError
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilType, build_soil_tables, load_soil_types

GRID = Grid(61, 61, 0.2)
SHIPPED = load_soil_types()
SAND, CLAY = SoilType(repose_angle=34.0, swell=0.1), SoilType(swell=0.4)


def columns_of(*kinds: SoilType) -> Columns:
    return Columns(GRID, np.zeros(GRID.shape), soil_depth=5.0, tables=build_soil_tables(kinds))


def step_down(height: float, params: SoilParams) -> Soil:
    """Return relaxed ground with a vertical step of a height [m]."""
    heights = np.zeros(GRID.shape)
    heights[:, 30:] = -height
    soil = Soil(GRID, heights, params)
    soil.relaxation.mark_all_disturbed()
    while soil.relaxation.relax(10**6):
        pass
    return soil


# The file


@pytest.mark.parametrize(
    ("name", "angle", "swell"),
    [
        ("reference", (30, 30), (0.0, 0.0)),
        ("dry sand", (34, 34), (0.05, 0.15)),
        ("wet sand", (45, 45), (0.05, 0.15)),
        ("gravel", (30, 45), (0.05, 0.15)),
        ("loam", (35, 40), (0.1, 0.35)),
        ("topsoil", (35, 40), (0.1, 0.25)),
        ("dry clay", (25, 40), (0.3, 0.6)),
        ("wet clay", (15, 15), (0.3, 0.6)),
        ("rock", (40, 40), (0.5, 0.8)),
    ],
)
def test_shipped_soils_are_within_published_ranges(
    name: str, angle: tuple[float, float], swell: tuple[float, float]
) -> None:
    kind = SHIPPED[name]
    assert angle[0] - 0.01 <= math.degrees(kind.repose_angle_at(kind.moisture)) <= angle[1] + 0.01
    assert swell[0] <= kind.swell <= swell[1]
    assert kind.is_rock == (name == "rock")
    assert kind.sources


def test_repose_angle_is_linear_in_moisture_between_given_values() -> None:
    kind = SHIPPED["dry sand"]
    degrees = [math.degrees(kind.repose_angle_at(moisture)) for moisture in (0, 25, 50, 75, 100)]
    assert degrees == pytest.approx([34, 39.5, 45, 35, 25])
    table = build_soil_tables([kind]).repose_tan[0]
    assert table.shape == (MOISTURE_LEVELS,)
    assert table[[0, 50, 100]] == pytest.approx(np.tan(np.radians([34, 45, 25])))


def test_critical_height_is_that_of_terzaghi() -> None:
    kind = SoilType(cohesion=10_000.0, density=1600.0, internal_friction=30.0)
    assert kind.critical_height(0) == pytest.approx(4 * 10_000 / (1600 * 9.81) * math.sqrt(3))
    assert SoilType().critical_height(0) == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "map names of soils"),
        ("mud: 3", "'mud' must be a mapping"),
        ("mud: {slope: 3}", "mud: SoilType has no parameter slope"),
        ("mud: {repose_angle: 99.0}", r"mud: .*repose_angle is 99\.0 deg"),
        ("mud: {compressive_strength: 10000000.0}", "give both for rock"),
        ("mud: {colour: [1.0]}", "red, green and blue"),
    ],
)
def test_invalid_file_of_soils_is_rejected(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises((SoilError, ParameterError), match=message):
        load_soil_types(str(path))


def test_missing_file_of_soils_is_an_error_though_no_soil_is_named() -> None:
    with pytest.raises(ConfigError, match=r"missing\.yaml"):
        SoilParams(soils="missing.yaml").soil_types()


def test_name_and_properties_of_a_soil_are_exclusive() -> None:
    assert SoilParams(soil="gravel").soil_types() == (SHIPPED["gravel"],)
    with pytest.raises(ParameterError, match=r"there is no soil 'mud' in soils\.yaml; it has"):
        SoilParams(soil="mud").soil_types()
    with pytest.raises(ParameterError, match="leave repose_angle and swell out"):
        SoilParams(soil="gravel", swell=0.2).soil_types()
    others = SoilParams(repose_angle=33.0, additional_soils=("rock", "loam")).soil_types()
    assert [math.degrees(each.repose_angle_at(0)) for each in others[:1]] == pytest.approx([33.0])
    assert others[1:] == (SHIPPED["rock"], SHIPPED["loam"])


def test_invalid_layers_are_rejected() -> None:
    ids = np.full(GRID.shape, 2)
    with pytest.raises(SoilError, match=r"layer soil .* values 0 to 0"):
        Soil(GRID, np.zeros(GRID.shape), soil=ids)
    with pytest.raises(SoilError, match="layer moisture"):
        Soil(GRID, np.zeros(GRID.shape), moisture=np.full(GRID.shape, 101))
    with pytest.raises(SoilError, match=r"shape \(61, 61\)"):
        Soil(GRID, np.zeros(GRID.shape), moisture=np.zeros((3, 3), dtype=np.uint8))


# Columns


def test_kind_of_loose_soil_is_the_majority_kind() -> None:
    columns = columns_of(SAND, CLAY)
    arrays = columns.arrays
    add_loose(arrays, 5, 1000, 1100, 0, 0)
    add_loose(arrays, 5, 900, 1260, 1, 0)
    assert columns.loose_soil.flat[5] == 0
    add_loose(arrays, 5, 101, 141, 1, 0)
    assert columns.loose_soil.flat[5] == 1
    add_loose(arrays, 5, 100, 110, 0, 0)
    assert columns.loose_soil.flat[5] == 0, "half and a little more is sand again"
    assert columns.loose.flat[5] == 2101
    assert remove_loose(arrays, 5, 2101) == 1100 + 1260 + 141 + 110
    assert (columns.loose.flat[5], columns.bulk.flat[5]) == (0, 0)


def test_moisture_mixes_by_volume() -> None:
    columns = columns_of(SAND)
    arrays = columns.arrays
    add_loose(arrays, 5, 3000, 3300, 0, 10)
    assert columns.top_moisture.flat[5] == 10
    add_loose(arrays, 5, 1000, 1100, 0, 50)
    assert columns.top_moisture.flat[5] == 20
    assert columns.moisture.flat[5] == 0, "the ground under it stays as it was"


def test_compaction_reduces_bulk_volume_only_down_to_bank_volume() -> None:
    columns = columns_of(CLAY)
    arrays = columns.arrays
    add_loose(arrays, 5, 10_000_000, 14_000_000, 0, 0)
    before, high = columns.total_mm3, columns.height.flat[5]
    assert compact_loose(arrays, 5, 3e6) == 3_000_000
    assert compact_loose(arrays, 5, 9e9) == 1_000_000
    assert compact_loose(arrays, 5, 9e9) == 0
    assert columns.total_mm3 == before
    assert columns.bulk.flat[5] == columns.loose.flat[5]
    assert high - columns.height.flat[5] == pytest.approx(4e6 * columns.metres_per_mm3)


def test_removing_loose_soil_in_parts_removes_all_of_it() -> None:
    columns = columns_of(CLAY)
    arrays, rng = columns.arrays, np.random.default_rng(0)
    for _ in range(200):
        bank = int(rng.integers(1, 10**7))
        add_loose(arrays, 7, bank, int(bank * 1.4), 0, 0)
        while columns.loose.flat[7]:
            took = remove_loose(arrays, 7, int(rng.integers(1, 10**7)))
            assert took >= 0
            assert columns.bulk.flat[7] >= columns.loose.flat[7] >= 0
        assert columns.bulk.flat[7] == 0


# Standing and failing


@pytest.mark.parametrize(("name", "stands"), [("dry clay", True), ("dry sand", False)])
def test_vertical_face_is_stable_in_clay_and_fails_in_sand(name: str, stands: bool) -> None:
    soil = step_down(1.5, SoilParams(soil=name))
    assert (soil.columns.loose.sum() == 0) == stands
    assert soil.relaxation.max_slope_excess() <= 0.003
    assert soil.verify_volume()


def test_face_above_critical_height_fails_to_its_repose_angle(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("weak: {cohesion: 3000.0, density: 1500.0, swell: 0.2}")
    kind = load_soil_types(str(own))["weak"]
    high = kind.critical_height(0)
    assert 1.0 < high < 1.5
    params = SoilParams(soil="weak", soils=str(own))
    assert step_down(0.95 * high, params).columns.loose.sum() == 0
    failed = step_down(1.3 * high, params)
    assert failed.columns.loose.sum() > 0
    assert failed.relaxation.max_slope_excess() <= 0.003
    assert failed.verify_volume()


def test_loose_soil_slides_off_a_stable_face_without_changing_it() -> None:
    soil = step_down(1.0, SoilParams(soil="dry clay"))
    firm = soil.columns.firm.copy()
    x, y = soil.grid.x(30.0), soil.grid.y(29.0)
    for tick in range(20):
        soil.step(tick, NO_SWEEPS, make_deposit_requests(np.full(50, x), np.full(50, y), 4_000_000))
    while soil.relaxation.relax(10**6):
        pass
    assert (soil.columns.firm == firm).all()
    assert soil.columns.loose[:, 30:].sum() > 0
    assert soil.relaxation.max_slope_excess() <= 0.003


def test_each_kind_of_soil_fails_at_its_own_angle() -> None:
    ids = np.zeros(GRID.shape, dtype=np.uint8)
    ids[:30] = 1
    heights = np.zeros(GRID.shape)
    heights[:, 30:] = -1.0
    soil = Soil(
        GRID, heights, SoilParams(soil="dry sand", additional_soils=("dry clay",)), soil=ids
    )
    soil.relaxation.mark_all_disturbed()
    while soil.relaxation.relax(10**6):
        pass
    assert soil.columns.loose[45:].sum() > 0
    assert soil.columns.loose[:15].sum() == 0
    assert soil.relaxation.max_slope_excess() <= 0.003


# Surface material, and published properties


def test_surface_material_is_excavated_after_a_cut_and_loose_after_deposition() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="dry clay"))
    soil.step(0, bucket_sweep((0.5, 0, 0.1), (0.5, 0, -0.2)), NO_DEPOSIT_REQUESTS)
    soil.step(1, bucket_sweep((0.5, 0, -0.2), (0.6, 0, -0.2)), NO_DEPOSIT_REQUESTS)
    soil.step(2, NO_SWEEPS, make_deposit_requests(-3.0, -3.0, 8_000_000))
    material = soil.columns.material
    assert (
        material[round(soil.grid.row(0.4)), round(soil.grid.col(0.0))] == SurfaceMaterial.EXCAVATED
    )
    assert material[round(soil.grid.row(-3.0)), round(soil.grid.col(-3.0))] == SurfaceMaterial.LOOSE
    assert material[0, 0] == SurfaceMaterial.UNDISTURBED


def test_soil_that_slides_over_a_slope_leaves_no_loose_surface_on_it() -> None:
    heights = np.tile(-0.2 * math.tan(math.radians(30.0)) * np.arange(61.0), (61, 1))
    soil = Soil(GRID, heights, reference_soil())
    x, y = soil.grid.x(30.0), soil.grid.y(10.0)
    for tick in range(4):  # more would back up from the foot
        soil.step(tick, NO_SWEEPS, make_deposit_requests(x, y, 2_000_000))
    while soil.relaxation.relax(10**6):
        pass
    soil.step(99, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    material = soil.columns.material
    assert (material[30, 56:] == SurfaceMaterial.LOOSE).any(), "it came to lie at the foot"
    assert (material[:, 20:45] == SurfaceMaterial.UNDISTURBED).all()


def test_kind_and_moisture_are_kept_by_excavation_and_deposition() -> None:
    params = SoilParams(soil="dry sand", additional_soils=("dry clay",))
    soil = Soil(GRID, np.zeros(GRID.shape), params, soil=np.ones(GRID.shape, dtype=np.uint8))
    step = soil.step(0, bucket_sweep((0.5, 0, 0.1), (0.5, 0, -0.2)), NO_DEPOSIT_REQUESTS)
    assert set(step.conversions["soil"].tolist()) == {1}
    rows = make_deposit_requests(-3.0, -3.0, 8_000_000)
    rows["soil"], rows["moisture"] = 0, 60
    soil.step(1, NO_SWEEPS, rows)
    at = (round(soil.grid.row(-3.0)), round(soil.grid.col(-3.0)))
    assert soil.columns.top_soil[at] == 0
    assert soil.columns.top_moisture[at] == 60


@pytest.mark.parametrize(("field", "value"), [("soil", 1), ("moisture", 101)])
def test_deposit_of_unknown_kind_or_moisture_is_rejected(field: str, value: int) -> None:
    soil = Soil(GRID, np.zeros(GRID.shape))
    rows = make_deposit_requests(0.0, 0.0, 1000)
    rows[field] = value
    step = soil.step(0, NO_SWEEPS, rows)
    assert step.conversions["kind"].tolist() == [3]
    assert soil.columns.loose.sum() == 0


def test_state_hash_depends_on_kinds_and_moisture() -> None:
    ids = np.zeros(GRID.shape, dtype=np.uint8)
    other = ids.copy()
    other[4, 4] = 1
    params = SoilParams(soil="dry sand", additional_soils=("gravel",))
    hashes = {
        Soil(GRID, np.zeros(GRID.shape), params, soil=ids).state_hash(),
        Soil(GRID, np.zeros(GRID.shape), params, soil=other).state_hash(),
        Soil(GRID, np.zeros(GRID.shape), params, soil=ids, moisture=ids + other).state_hash(),
    }
    assert len(hashes) == 3


def test_loose_soil_has_bearing_properties_for_tracks_and_rock_is_rigid() -> None:
    kinds = load_soil_types()
    loam = kinds["loam"].loose_soil
    assert loam.bekker_k_phi == 1_515_040.0
    assert (
        loam.moisture_bearing_factor(0),
        loam.moisture_bearing_factor(75),
        loam.moisture_bearing_factor(100),
    ) == pytest.approx((1.0, 0.365, 0.13))
    assert loam.internal_friction == kinds["loam"].internal_friction
    for name in ("reference", "gravel", "rock"):
        assert kinds[name].loose_soil.bekker_k_phi == 0.0

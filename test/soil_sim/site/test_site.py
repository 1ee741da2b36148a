"""Initial site of a node: terrain, layers, design, and errors that name the parameter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.errors import EarthmovingError, ParameterError
from msg_bridge.contract.grid import Grid
from soil_sim.errors import SoilError, TerrainErrorCode
from soil_sim.site.site import Site, SiteParams, make_site
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import Georeference, HeightMap, Layers, flat, save_layer, save_terrain

GRID = Grid(5, 4, 0.5)
HEIGHTS = np.arange(20.0).reshape(GRID.shape)
IDS = (np.arange(20) % 3).astype(np.uint8).reshape(GRID.shape)
PERCENT = (5 * np.arange(20)).astype(np.uint8).reshape(GRID.shape)
THREE = SoilParams(additional_soils=("dry clay", "gravel"))


def saved(folder: Path, name: str, layers: Layers | None = None) -> str:
    save_terrain(folder / name, HeightMap(GRID, HEIGHTS), layers=layers)
    return str(folder / name)


def saved_layer(folder: Path, name: str, kind: str, grid: Grid = GRID) -> str:
    layer = {"soil": IDS, "moisture": PERCENT}[kind]
    save_layer(folder / name, np.resize(layer, grid.shape), grid, kind=kind)
    return str(folder / name)


def test_synthetic_terrain_has_no_layers_and_no_design() -> None:
    site = make_site(SiteParams(terrain="flat", num_points=9, cell=0.5))
    assert site.grid == Grid(9, 9, 0.5)
    assert not site.heights.any()
    assert (site.layers.soil, site.layers.moisture, site.design) == (None, None, None)
    assert site.georeference is None
    assert site.cut_fill(site.heights) is None


def test_layers_of_an_archive_are_used_by_default(tmp_path: Path) -> None:
    site = make_site(SiteParams(terrain=saved(tmp_path, "own.npz", Layers(IDS, PERCENT))))
    assert np.array_equal(site.heights, HEIGHTS)
    soil = site.make_soil(THREE)
    assert np.array_equal(soil.columns.soil, IDS)
    assert np.array_equal(soil.columns.moisture, PERCENT)


def test_archive_without_layers_has_one_soil(tmp_path: Path) -> None:
    site = make_site(SiteParams(terrain=saved(tmp_path, "own.npz")))
    soil = site.make_soil(SoilParams(soil="wet sand"))
    assert not soil.columns.soil.any()
    assert (soil.columns.moisture == soil.soil_types[0].moisture).all()


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".asc", ".tif"])
def test_soil_and_moisture_maps_combine_with_any_terrain_file(tmp_path: Path, suffix: str) -> None:
    site = make_site(
        SiteParams(
            terrain=saved(tmp_path, "ground.asc"),
            soil_map=saved_layer(tmp_path, f"soil{suffix}", "soil"),
            moisture_map=saved_layer(tmp_path, f"moisture{suffix}", "moisture"),
        )
    )
    soil = site.make_soil(THREE)
    assert np.array_equal(soil.columns.soil, IDS)
    assert np.array_equal(soil.columns.moisture, PERCENT)


def test_soil_and_moisture_maps_combine_with_synthetic_terrain(tmp_path: Path) -> None:
    path = saved_layer(tmp_path, "soil.npy", "soil", Grid(9, 9, 0.2))
    site = make_site(SiteParams(terrain="rough", num_points=9, soil_map=path))
    assert np.array_equal(site.make_soil(THREE).columns.soil, np.resize(IDS, (9, 9)))


def test_given_map_overrides_the_layer_of_an_archive(tmp_path: Path) -> None:
    terrain = saved(tmp_path, "own.npz", Layers(np.zeros_like(IDS), PERCENT))
    path = saved_layer(tmp_path, "soil.npy", "soil")
    soil = make_site(SiteParams(terrain=terrain, soil_map=path)).make_soil(THREE)
    assert np.array_equal(soil.columns.soil, IDS)
    assert np.array_equal(soil.columns.moisture, PERCENT)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".asc", ".tif"])
def test_vertical_scale_converts_feet_to_metres(tmp_path: Path, suffix: str) -> None:
    terrain = saved(tmp_path, f"feet{suffix}")
    site = make_site(SiteParams(terrain=terrain, cell=0.5, vertical_scale=0.3048))
    assert site.heights == pytest.approx(0.3048 * HEIGHTS, rel=1e-6)


def test_cell_size_stored_in_a_file_overrides_the_parameter(
    tmp_path: Path,
) -> None:
    assert make_site(SiteParams(terrain=saved(tmp_path, "own.png"), cell=0.2)).grid == GRID
    terrain = saved(tmp_path, "own.npy")
    assert make_site(SiteParams(terrain=terrain, cell=0.2)).grid == Grid(5, 4, 0.2)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".asc", ".tif"])
def test_design_of_any_format_is_compared_with_the_terrain(tmp_path: Path, suffix: str) -> None:
    path = saved(tmp_path, f"design{suffix}")
    save_terrain(tmp_path / "ground.asc", flat(GRID))
    site = make_site(SiteParams(terrain=str(tmp_path / "ground.asc"), design=path))
    assert site.design is not None
    result = site.cut_fill(site.heights)
    assert result is not None
    assert result.cut == 0.0
    assert result.fill == pytest.approx(HEIGHTS.sum() * 0.25, abs=1e-2)


def test_vertical_scale_applies_to_terrain_and_design(tmp_path: Path) -> None:
    path = saved(tmp_path, "feet.npz")
    site = make_site(SiteParams(terrain=path, design=path, vertical_scale=0.3048))
    result = site.cut_fill(site.heights)
    assert result is not None
    assert (result.remaining, result.within_tolerance) == (0.0, 1.0)


def test_design_has_the_given_tolerance(tmp_path: Path) -> None:
    path = saved(tmp_path, "design.npz")
    site = make_site(SiteParams(terrain=path, design=path, design_tolerance=0.2))
    result = site.cut_fill(site.heights + 0.15)
    assert result is not None
    assert result.within_tolerance == 1.0


def test_height_range_applies_to_a_design_image(
    tmp_path: Path,
) -> None:
    from PIL import Image

    grey = np.full((4, 5), 65535, dtype=np.uint16)  # a north-up image, 5 pixels wide along x
    Image.fromarray(grey).save(tmp_path / "design.png")
    params = SiteParams(
        terrain=saved(tmp_path, "ground.asc"),
        design=str(tmp_path / "design.png"),
        png_min_height=-1.0,
        png_max_height=3.0,
    )
    design = make_site(params).design
    assert design is not None
    assert (design.heights == 3.0).all()


def bad(folder: Path, **given: object) -> SiteParams:
    """Return parameters with file names in the folder."""
    names = ("terrain", "soil_map", "moisture_map", "design")
    paths = {n: str(folder / str(given[n])) for n in names if n in given}
    return SiteParams(**{"terrain": "flat", **given, **paths})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "parameter", "code"),
    [
        ({"terrain": "none.asc"}, "terrain", TerrainErrorCode.NO_FILE),
        (
            {"terrain": "own.npy", "soil_map": "half.npy"},
            "soil_map",
            TerrainErrorCode.LAYER_VALUE,
        ),
        ({"soil_map": "soil.npy"}, "soil_map", TerrainErrorCode.SHAPE),
        ({"soil_map": "none.npy"}, "soil_map", TerrainErrorCode.NO_FILE),
        ({"moisture_map": "none.npy"}, "moisture_map", TerrainErrorCode.NO_FILE),
        (
            {"terrain": "own.npy", "moisture_map": "deep.npy"},
            "moisture_map",
            TerrainErrorCode.LAYER_VALUE,
        ),
        ({"design": "none.npy"}, "design", TerrainErrorCode.NO_FILE),
        ({"design": "design.jpeg"}, "design", TerrainErrorCode.UNSUPPORTED),
        ({"terrain": "far.npz", "design": "place.npz"}, "design", TerrainErrorCode.OFF_MAP),
    ],
)
def test_error_of_an_invalid_file_names_its_parameter(
    tmp_path: Path, given: dict[str, object], parameter: str, code: TerrainErrorCode
) -> None:
    saved(tmp_path, "own.npy")
    saved_layer(tmp_path, "soil.npy", "soil")
    np.save(tmp_path / "half.npy", HEIGHTS + 0.5)
    np.save(tmp_path / "deep.npy", HEIGHTS - 1000.0)
    for name, east in (("place.npz", 0.0), ("far.npz", 9000.0)):
        place = Georeference("EPSG:32633", 5e5 + east, 5e6)
        save_terrain(tmp_path / name, HeightMap(GRID, HEIGHTS + 0.5, place))
    with raises_terrain_error(code, match=rf"^site\.{parameter}: "):
        make_site(bad(tmp_path, **given))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"vertical_scale": 0.3048}, r"site\.vertical_scale is 0\.3048 and no file"),
        (
            {"png_min_height": 1.0},
            r"site\.png_min_height and site\.png_max_height apply to a \.png",
        ),
        (
            {"terrain": "own.npy", "png_max_height": 1.0},
            r"site\.png_min_height and site\.png_max_height apply to a \.png",
        ),
    ],
)
def test_parameter_without_its_file_is_rejected(
    tmp_path: Path, given: dict[str, object], message: str
) -> None:
    saved(tmp_path, "own.npy")
    with pytest.raises(ParameterError, match=message):
        make_site(bad(tmp_path, **given))


def test_error_of_an_unknown_soil_id_names_the_parameter() -> None:
    site = Site(HeightMap(GRID, HEIGHTS), Layers(soil=IDS))
    with pytest.raises(
        SoilError, match=r"site\.soil_map.* go to 2, but soil\.additional_soils names 1"
    ):
        site.make_soil(SoilParams(additional_soils=("dry clay",)))
    assert site.make_soil(THREE).columns.soil.max() == 2


def test_moisture_of_site_and_of_soil_are_exclusive() -> None:
    site = Site(HeightMap(GRID, HEIGHTS), Layers(moisture=PERCENT))
    with pytest.raises(EarthmovingError, match=r"soil\.moisture is 50 and site\.moisture_map"):
        site.make_soil(SoilParams(moisture=50))

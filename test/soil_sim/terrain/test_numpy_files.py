"""NumPy files are in matrix order, complete, numeric and never unpickled."""

import numpy as np
import pytest
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import load_terrain


def npz(folder, **arrays):
    path = folder / "site.npz"
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("dtype", ["<i2", ">i4", "u1", "<f4", ">f8", "f2"])
def test_array_of_any_numeric_type_is_read_in_matrix_order(tmp_path, dtype):
    heights = np.arange(12).reshape(3, 4)
    np.save(tmp_path / "site.npy", np.asfortranarray(heights.astype(dtype)))
    loaded = load_terrain(tmp_path / "site.npy", cell=0.5)
    assert loaded.grid == Grid(3, 4, 0.5)
    assert np.array_equal(loaded.heights, heights)


def test_npy_without_cell_size_is_rejected(tmp_path):
    np.save(tmp_path / "site.npy", np.zeros((3, 3)))
    with raises_terrain_error(
        TerrainErrorCode.CELL_SIZE, match=r"site\.npy: it states no spacing.*give cell"
    ):
        load_terrain(tmp_path / "site.npy")


@pytest.mark.parametrize("shape", [(), (4,), (2, 2, 2), (1, 5), (5, 1), (0, 0)])
def test_array_of_invalid_shape_is_rejected(tmp_path, shape):
    np.save(tmp_path / "site.npy", np.zeros(shape))
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        load_terrain(tmp_path / "site.npy", cell=0.5)


@pytest.mark.parametrize("dtype", ["c16", "U3", "M8[s]", "?", "f4,f4"])
def test_non_numeric_array_is_rejected(tmp_path, dtype):
    np.save(tmp_path / "site.npy", np.zeros((3, 3), dtype=dtype))
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_terrain(tmp_path / "site.npy", cell=0.5)


class _Trap:
    def __reduce__(self):
        return (pytest.fail, ("the file was unpickled",))


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_pickled_objects_are_not_loaded(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    trap = np.full((3, 3), _Trap(), dtype=object)
    if suffix == ".npy":
        np.save(path, trap, allow_pickle=True)
    else:
        np.savez(path, heights=trap, cell=0.5)
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(path, cell=0.5)


def test_nan_height_is_rejected(tmp_path):
    heights = np.zeros((3, 3))
    heights[1, 2] = np.nan
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        load_terrain(npz(tmp_path, heights=heights, cell=0.5))


def test_archive_named_npy_is_rejected(tmp_path):
    npz(tmp_path, heights=np.zeros((3, 3)), cell=0.5).rename(tmp_path / "site.npy")
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(tmp_path / "site.npy", cell=0.5)


def test_array_named_npz_is_rejected(tmp_path):
    np.save(tmp_path / "site.npy", np.zeros((3, 3)))
    (tmp_path / "site.npy").rename(tmp_path / "site.npz")
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(tmp_path / "site.npz")


@pytest.mark.parametrize(
    "arrays",
    [
        {"elevation": np.zeros((3, 3))},
        {"heights": np.zeros((3, 3))},
        {"heights": np.zeros((3, 3)), "cell": 0.5, "snow": 1},
        {"heights": np.zeros((3, 3)), "cell": 0.5, "easting": 1.0},
    ],
    ids=["no heights", "no cell", "unknown", "half a georeference"],
)
def test_missing_or_unknown_array_is_rejected(tmp_path, arrays):
    with raises_terrain_error(TerrainErrorCode.KEYS):
        load_terrain(npz(tmp_path, **arrays))


@pytest.mark.parametrize("cell", [0.0, -1.0, np.nan, np.inf, "half", [0.5, 0.5], 1j])
def test_invalid_cell_size_in_an_archive_is_rejected(tmp_path, cell):
    with raises_terrain_error(TerrainErrorCode.CELL_SIZE):
        load_terrain(npz(tmp_path, heights=np.zeros((3, 3)), cell=cell))

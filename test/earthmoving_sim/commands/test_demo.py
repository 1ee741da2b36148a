"""`earthmoving demo`: its options, and input that it rejects before it runs."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from earthmoving_sim.cli import main
from msg_bridge.contract.grid import Grid
from soil_sim.terrain import HeightMap, flat, save_terrain, slope


def test_unstable_ground_is_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steep = tmp_path / "steep.npz"
    save_terrain(steep, slope(Grid(129, 129, 0.4), np.radians(50.0), 0.0))
    assert main(["demo", "--terrain", str(steep), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "50 deg" in error
    assert "35 deg" in error


def test_map_without_the_machine_is_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "far.yaml"
    config.write_text("run: {start_x: 500.0}\n")
    ground = tmp_path / "flat.npz"
    save_terrain(ground, flat(Grid(65, 65, 0.4)))
    arguments = ["demo", "--terrain", str(ground), "--config", str(config)]
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    assert "start_x" in capsys.readouterr().err


def test_output_folder_that_cannot_be_created_is_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    assert main(["demo", "--out", str(file)]) == 2
    assert str(file) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ("--in-process --view", "--view shows what nodes publish; leave out --in-process"),
        ("--in-process --foxglove", "--foxglove shows what nodes publish; leave out --in-process"),
        ("--in-process --bag a", "--bag records what nodes publish; leave out --in-process"),
        ("--in-process --realtime", "--realtime is a mode of the nodes; leave out --in-process"),
        ("--cell 3", "--cell describes a terrain file; add --terrain"),
        ("--height-range 1 5", "--height-range describes a terrain file; add --terrain"),
        ("--load --cycles 2", "with --load give --loads or --minutes"),
        ("--loads 2", "--loads is for a dumper that is loaded; add --load"),
        ("--load --loads 2 --minutes 9", "give one of them"),
        ("--cycles 0", "--cycles is 0; give a value from 1"),
        ("--load --loads 0", "--loads is 0; give a value from 1"),
        ("--load --minutes -1", "--minutes -1 is -60.0 s; give a value from 0.0"),
        ("--seed -1", "--seed is -1; give a value from 0"),
    ],
)
def test_options_without_effect_or_out_of_range_are_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: str, error: str
) -> None:
    out = tmp_path / "out"
    assert main(["demo", *options.split(), "--out", str(out)]) == 2
    assert error in capsys.readouterr().err
    assert not out.exists()


def test_foxglove_without_its_sdk_is_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    assert main(["demo", "--foxglove", "--out", str(tmp_path)]) == 2
    assert "pip install foxglove-sdk" in capsys.readouterr().err


def test_height_range_scales_a_png_and_no_other_site_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "ground.png"
    Image.fromarray(np.full((65, 65), 32768, dtype=np.uint16)).save(picture)
    sites: list[HeightMap] = []

    class StopHereError(Exception):
        pass

    def stop(config: object, site: HeightMap) -> None:
        sites.append(site)
        raise StopHereError

    monkeypatch.setattr("earthmoving_sim.single_process_dig.SingleProcessDig", stop)
    monkeypatch.setattr("earthmoving_sim.demo_site.jacksboro_site", pytest.fail)
    arguments = [
        "demo",
        "--in-process",
        "--terrain",
        str(picture),
        "--cell",
        "0.6",
        "--out",
        str(tmp_path),
    ]
    with pytest.raises(StopHereError):
        main([*arguments, "--height-range", "2", "4"])
    assert sites[0].heights[0, 0] == pytest.approx(3.0, abs=1e-3)


def test_unknown_soil_is_rejected_with_the_known_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--soil", "wet caly", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "'wet caly'" in error
    assert "wet clay" in error
    assert "loam" in error

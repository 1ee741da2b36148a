"""What `earthmoving demo` says to input it cannot use, before it has run for minutes."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from earthmoving_sim.cli import main
from msg_bridge.contract.grid import Grid
from soil_sim.terrain import flat, save_terrain, slope


def test_ground_that_would_slide_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    steep = tmp_path / "steep.npz"
    save_terrain(steep, slope(Grid(129, 129, 0.4), np.radians(50.0), 0.0))
    assert main(["demo", "--terrain", str(steep), "--out", str(tmp_path)]) == 2
    assert "slopes of 50 deg, and the soil stands at 35 deg" in capsys.readouterr().err


def test_a_map_without_room_for_the_machine_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "far.yaml"
    config.write_text("run: {start_x: 500.0}\n")
    ground = tmp_path / "flat.npz"
    save_terrain(ground, flat(Grid(65, 65, 0.4)))
    arguments = ["demo", "--terrain", str(ground), "--config", str(config)]
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    assert "set start_x and start_y" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_refused_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file")
    assert main(["demo", "--out", str(taken)]) == 2
    assert "name another" in capsys.readouterr().err


def test_an_ordinary_png_digs_with_its_height_range(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "ground.png"
    Image.fromarray(np.full((65, 65), 32768, dtype=np.uint16)).save(picture)
    seen = []

    class StopHereError(Exception):
        pass

    def stop(config: object, site: object) -> None:
        seen.append(site)
        raise StopHereError

    monkeypatch.setattr("earthmoving_sim.single_process_dig.SingleProcessDig", stop)
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
    assert seen[0].heights[0, 0] == pytest.approx(3.0, abs=1e-3)

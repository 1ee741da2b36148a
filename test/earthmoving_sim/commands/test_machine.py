"""`earthmoving machine check FILE`: valid and invalid files."""

from pathlib import Path

import pytest
import yaml

from earthmoving_sim import cli
from machine_sim.machine import load_machine_spec
from msg_bridge.config_files import find_config

SHIPPED = ("excavator", "road_header", "dumper", "reference_2014")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_machines_stand_level_with_both_track_models(name, capsys) -> None:
    assert cli.main(["machine", "check", f"machines/{name}.yaml"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{name}: ")
    assert out.count("stands tilted by") == 2
    assert "it tips up" not in out


@pytest.mark.parametrize("name", ["excavator", "dumper"])
def test_documented_capacities_are_those_of_the_tool(name) -> None:
    page = (Path(__file__).parents[3] / "docs/machines.md").read_text("utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith(f"| `{name}.yaml`"))
    (tool,) = load_machine_spec(find_config(f"machines/{name}.yaml")).tools.values()
    struck, heaped = tool.shape.struck_capacity, tool.shape.heaped_capacity
    assert f"{struck:.2f} m³ struck and {heaped:.2f} m³ heaped" in row


def changed(tmp_path, edit):
    values = yaml.safe_load(find_config("machines/road_header.yaml").read_text())
    edit(values)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return str(path)


def rename_shoe_width(values):
    values["tracks"]["shoe_widht"] = values["tracks"].pop("shoe_width")


@pytest.mark.parametrize(
    ("edit", "key"),
    [
        (lambda v: v["tools"]["head"].update(body=0.6), "tools.head"),
        (lambda v: v["links"].pop("turret"), "links.turret"),
        (lambda v: v["joystick_axes"]["turn"].update(axis="left_z"), "joystick_axes.turn"),
        (lambda v: v["tracks"].update(shoe_thickness=0.8), "tracks"),
        (lambda v: v["tracks"].update(shoe_widht=0.5), "(did you mean 'shoe_width'?)"),
        (
            rename_shoe_width,
            "tracks.shoe_width is missing, but there is 'shoe_widht' (did you mean 'shoe_width'?)",
        ),
    ],
)
def test_invalid_file_is_rejected_with_its_section(edit, key, tmp_path, capsys) -> None:
    assert cli.main(["machine", "check", changed(tmp_path, edit)]) == 2
    assert key in capsys.readouterr().err


def test_machine_that_tips_up_is_reported(tmp_path, capsys) -> None:
    path = changed(tmp_path, lambda v: v["links"]["base"].update(center_of_mass=[-4.0, 0.0, 0.65]))
    assert cli.main(["machine", "check", path]) == 0
    assert "it tips up" in capsys.readouterr().out


def test_missing_file_is_rejected(capsys) -> None:
    assert cli.main(["machine", "check", "none.yaml"]) == 2
    assert "none.yaml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (("--picture", "d.txt"), "--picture d.txt: give a name that ends in .png"),
        (("--mesh", "d.obj"), "--mesh d.obj: give a name that ends in .glb"),
        (("--picture", "none/d.png"), "there is no folder for --picture none/d.png"),
        (("--mesh", "folder.glb"), "--mesh folder.glb is a folder"),
    ],
)
def test_output_that_cannot_be_written_is_rejected_before_the_machine_is_measured(
    options, error, tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.glb").mkdir()
    assert cli.main(["machine", "check", "machines/road_header.yaml", *options]) == 2
    captured = capsys.readouterr()
    assert error in captured.err
    assert captured.out == ""

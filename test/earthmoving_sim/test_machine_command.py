"""`earthmoving machine check FILE`: what it says of good and of bad files."""

import pytest
import yaml

from earthmoving_sim import cli
from msg_bridge.config_files import find_config

SHIPPED = ("excavator", "road_header", "dumper", "reference_2014")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_machines_are_sound_with_both_kinds_of_tracks(name, capsys) -> None:
    assert cli.main(["machine", "check", f"machines/{name}.yaml"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{name}: ")
    assert out.count("stands tilted by") == 2
    assert "it tips up" not in out


def changed(tmp_path, edit):
    values = yaml.safe_load(find_config("machines/road_header.yaml").read_text())
    edit(values)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return str(path)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda v: v["tools"]["head"].update(body=0.6), "tips of the picks farther out"),
        (lambda v: v["links"].pop("turret"), "links.turret is missing; add it"),
        (lambda v: v["levers"]["turn"].update(axis="left_z"), "levers.turn: give a joint"),
        (lambda v: v["tracks"].update(shoe_thickness=0.8), "too thick for a sprocket"),
    ],
)
def test_a_bad_file_is_refused_with_what_to_change(edit, words, tmp_path, capsys) -> None:
    assert cli.main(["machine", "check", changed(tmp_path, edit)]) == 2
    assert words in capsys.readouterr().err


def test_a_machine_that_tips_up_is_told(tmp_path, capsys) -> None:
    path = changed(tmp_path, lambda v: v["links"]["base"].update(center_of_mass=[-4.0, 0.0, 0.65]))
    assert cli.main(["machine", "check", path]) == 0
    assert "it tips up" in capsys.readouterr().out


def test_a_file_that_is_not_there_is_refused(capsys) -> None:
    assert cli.main(["machine", "check", "none.yaml"]) == 2
    assert "none.yaml" in capsys.readouterr().err

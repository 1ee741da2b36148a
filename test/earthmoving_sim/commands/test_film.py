"""`earthmoving film`: invalid input is reported before anything is drawn."""

from pathlib import Path

import pytest

from earthmoving_sim.cli import build_parser, main
from viewer.film.film import END

BAG = str(Path(__file__).parents[3] / "bags" / "format_2")


@pytest.fixture(autouse=True)
def no_browser_starts(monkeypatch):
    """Let the browser be found; a test that started it would fail."""
    monkeypatch.setenv("CHROMIUM", "/bin/false")


def film(tmp_path, *options, output="film.mp4"):
    return main(["film", BAG, "-o", str(tmp_path / output), *options])


@pytest.mark.parametrize(
    "options",
    [
        ("--size", "big"),
        ("--size", "641x360"),
        ("--fps", "0"),
        ("--speed", "-2"),
        ("--start", "1000"),
        ("--end", "1000"),
        ("--start", "9", "--end", "8"),
        ("--orbit", "a,b"),
        ("--orbit", "1,2,3,4"),
        ("--orbit", "0,95,10"),
        ("--orbit", "0,20,10", "--camera", "cab"),
        ("--machine", "crane"),
        ("--at", "5"),
    ],
)
def test_invalid_options_end_with_a_message_and_no_file(tmp_path, capsys, options):
    assert film(tmp_path, *options) == 2
    assert capsys.readouterr().err.startswith("earthmoving film: ")
    assert not (tmp_path / "film.mp4").exists()


@pytest.mark.parametrize(("text", "time"), [("5.5", 5.5), ("end", END)])
def test_time_of_a_picture_is_a_number_or_the_end(text, time):
    assert build_parser().parse_args(["film", BAG, "--at", text]).at == time


def test_other_word_as_time_of_a_picture_is_rejected(capsys):
    with pytest.raises(SystemExit):
        main(["film", BAG, "--at", "last"])
    assert "neither a time [s] nor `end`" in capsys.readouterr().err


def test_picture_needs_a_time(tmp_path, capsys):
    assert film(tmp_path, output="film.png") == 2
    assert "--at" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--start", "--end", "--fps", "--speed"])
def test_options_of_a_film_are_rejected_for_a_picture(tmp_path, capsys, option):
    assert film(tmp_path, "--at", "1", option, "3", output="film.png") == 2
    assert f"{option} is for a film" in capsys.readouterr().err


def test_unknown_machine_is_reported_with_those_there_are(tmp_path, capsys):
    assert film(tmp_path, "--machine", "crane") == 2
    assert "/excavator" in capsys.readouterr().err


def test_missing_browser_is_reported_with_what_to_do(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("CHROMIUM", "/no/such/browser")
    assert film(tmp_path) == 2
    assert "make chromium" in capsys.readouterr().err


def test_missing_bag_is_reported(tmp_path, capsys):
    assert main(["film", str(tmp_path / "none"), "-o", str(tmp_path / "film.mp4")]) == 2
    assert "none" in capsys.readouterr().err


def test_browser_that_ends_is_reported_with_its_output(tmp_path, capsys, monkeypatch):
    program = tmp_path / "browser"
    program.write_text("#!/bin/sh\necho cannot open display\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("CHROMIUM", str(program))
    assert film(tmp_path) == 2
    assert "cannot open display" in capsys.readouterr().err

"""`earthmoving play`: invalid options are reported by their names."""

from pathlib import Path

import pytest

from earthmoving_sim.cli import main

BAG = str(Path(__file__).parents[3] / "bags" / "format_2")


@pytest.mark.parametrize(
    ("option", "value", "error"),
    [
        ("--rate", "0", "--rate is 0.0; give a value from 0.01"),
        ("--start", "-1", "--start is -1.0 s; give a value from 0.0"),
        ("--include", "[", "--include is '[', which is not a regular expression"),
    ],
)
def test_invalid_option_is_reported_by_its_name(
    capsys: pytest.CaptureFixture[str], option: str, value: str, error: str
) -> None:
    assert main(["play", BAG, option, value]) == 2
    assert error in capsys.readouterr().err

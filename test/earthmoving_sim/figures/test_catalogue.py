"""The figures that can be made."""

import pytest

from earthmoving_sim.cli import main
from earthmoving_sim.figures.catalogue import NUMBERS, groups_of
from msg_bridge.contract.errors import EarthmovingError


def test_figures_5_and_18_to_30_can_be_made():
    assert sorted(NUMBERS) == [5, *range(18, 31)]


def test_figures_of_one_run_are_made_together():
    assert [group.numbers for group in groups_of([20, 30])] == [(19, 20), (29, 30)]


def test_unknown_figure_is_rejected():
    with pytest.raises(EarthmovingError, match="17"):
        groups_of([17, 18])


@pytest.mark.parametrize(
    "options", [("--only", "x"), ("--only", "17"), ("--size", "1"), ("-o", __file__)]
)
def test_command_rejects_invalid_options(tmp_path, capsys, monkeypatch, options):
    monkeypatch.setenv("CHROMIUM", "/bin/false")
    assert main(["figures", "-o", str(tmp_path), *options]) == 2
    assert capsys.readouterr().err.startswith("earthmoving figures: ")

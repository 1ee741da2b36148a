"""The `earthmoving` command line: help, exit codes, and subcommands that fail."""

import re
import subprocess
import sys
import types
from pathlib import Path

import pytest

from earthmoving_sim import cli
from msg_bridge.contract.errors import ParameterError

ROOT = Path(__file__).parents[2]


@pytest.fixture
def give_subcommand(monkeypatch):
    """Make `give` the only subcommand, whose `run` is the function passed."""

    def give(run):
        module = types.ModuleType("earthmoving_sim.give", "Give what is asked for.")
        module.SUMMARY = "give"
        module.add_arguments = lambda parser: parser.add_argument("--code", type=int, default=0)
        module.run = run
        monkeypatch.setitem(sys.modules, "earthmoving_sim.give", module)
        monkeypatch.setattr(cli, "SUBCOMMANDS", ("give",))

    return give


def raiser(error: BaseException):
    def run(args):
        raise error

    return run


def test_exit_code_is_what_the_subcommand_returns(give_subcommand):
    give_subcommand(lambda args: args.code)
    assert cli.main(["give", "--code", "7"]) == 7


def test_error_of_ours_is_a_message_and_exit_code_2(give_subcommand, capsys):
    give_subcommand(raiser(ParameterError("depth is negative; give 0 or more")))
    assert cli.main(["give"]) == 2
    captured = capsys.readouterr()
    assert captured.err == "earthmoving give: depth is negative; give 0 or more\n"
    assert captured.out == ""


def test_keyboard_interrupt_exits_with_130(give_subcommand):
    give_subcommand(raiser(KeyboardInterrupt()))
    assert cli.main(["give"]) == 130


def test_error_that_is_a_bug_is_not_swallowed(give_subcommand):
    give_subcommand(raiser(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        cli.main(["give"])


def test_subcommand_that_does_not_import_is_named_in_help_and_fails_when_called(
    monkeypatch, capsys
):
    monkeypatch.setattr(cli, "SUBCOMMANDS", ("nowhere",))
    assert cli.main(["nowhere"]) == 2
    assert "No module named 'earthmoving_sim.nowhere'" in capsys.readouterr().err
    assert "unavailable" in " ".join(cli.build_parser().format_help().split())


def test_no_subcommand_is_bad_input(capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main([])
    assert stop.value.code == 2
    assert "COMMAND" in capsys.readouterr().err


def test_help_lists_every_subcommand_and_examples():
    text = cli.build_parser().format_help()
    for name in cli.SUBCOMMANDS:
        assert re.search(rf"^ +{name} ", text, re.MULTILINE), name
        assert f"earthmoving {name}" in text
    assert "exit codes" in text


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from earthmoving_sim.cli import build_parser; build_parser().format_help();"
        "print(*{'numpy', 'numba', 'pybullet', 'rclpy', 'matplotlib'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


def test_runs_as_a_module():
    command = [sys.executable, "-m", "earthmoving_sim", "check", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0
    assert "--output" in done.stdout


def test_version_is_the_same_everywhere():
    setup = re.search(r'version="([^"]+)"', (ROOT / "setup.py").read_text())
    manifest = re.search(r"<version>(.+)</version>", (ROOT / "package.xml").read_text())
    assert setup is not None
    assert manifest is not None
    assert setup[1] == manifest[1]

"""The `earthmoving` command line: help, exit codes, and failing subcommands."""

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
def install_subcommand(monkeypatch):
    """Return a function that makes `fake` the only subcommand, with the given `run`."""

    def install(run):
        module = types.ModuleType("earthmoving_sim.commands.fake", "A fake subcommand.")
        module.SUMMARY = "fake"
        module.add_arguments = lambda parser: parser.add_argument("--code", type=int, default=0)
        module.run = run
        monkeypatch.setitem(sys.modules, "earthmoving_sim.commands.fake", module)
        monkeypatch.setattr(cli, "SUBCOMMANDS", ("fake",))

    return install


def raising(error: BaseException):
    def run(args):
        raise error

    return run


def test_exit_code_is_that_of_the_subcommand(install_subcommand):
    install_subcommand(lambda args: args.code)
    assert cli.main(["fake", "--code", "7"]) == 7


def test_earthmoving_error_is_printed_with_exit_code_2(install_subcommand, capsys):
    install_subcommand(raising(ParameterError("depth is negative; give 0 or more")))
    assert cli.main(["fake"]) == 2
    captured = capsys.readouterr()
    assert captured.err == "earthmoving fake: depth is negative; give 0 or more\n"
    assert captured.out == ""


def test_keyboard_interrupt_exits_with_130(install_subcommand):
    install_subcommand(raising(KeyboardInterrupt()))
    assert cli.main(["fake"]) == 130


def test_other_errors_are_raised(install_subcommand):
    install_subcommand(raising(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        cli.main(["fake"])


def test_subcommand_that_cannot_be_imported_is_listed_and_fails_when_called(monkeypatch, capsys):
    monkeypatch.setattr(cli, "SUBCOMMANDS", ("nowhere",))
    assert cli.main(["nowhere"]) == 2
    assert "No module named 'earthmoving_sim.commands.nowhere'" in capsys.readouterr().err
    assert "unavailable" in " ".join(cli.build_parser().format_help().split())


def test_missing_subcommand_is_invalid_input(capsys):
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


def test_help_imports_no_heavy_package():
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

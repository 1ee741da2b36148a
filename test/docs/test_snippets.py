"""Every Python, YAML and shell snippet of the documents works.

A block that no test can execute has a comment `<!-- not executed: REASON -->` directly above it.
"""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from itertools import filterfalse
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import pytest
import yaml
from sensor_msgs.msg import JointState

import dig_operator.usage
import machine_sim.node.usage
import msg_bridge.foxglove_server.usage
import msg_bridge.recorder.usage
import soil_sim.node.usage
import viewer.cameras.usage
import viewer.usage
from earthmoving_sim.cli import build_parser
from machine_sim.machine import load_machine_spec
from machine_sim.machine.shapes.link_meshes import link_meshes, num_triangles
from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.qos import STATE
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.interface import INTERFACE
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "examples/README.md", *sorted((ROOT / "docs").rglob("*.md"))]

USAGES = {
    "soil_sim": soil_sim.node.usage.USAGE,
    "machine_sim": machine_sim.node.usage.USAGE,
    "exchange_recorder": msg_bridge.recorder.usage.USAGE,
    "foxglove_server": msg_bridge.foxglove_server.usage.USAGE,
    "dig_operator": dig_operator.usage.USAGE,
    "viewer": viewer.usage.USAGE,
    "camera": viewer.cameras.usage.USAGE,
}
PROGRAMS = ("earthmoving", "python", "make", "ros2", *USAGES)


class Snippet(NamedTuple):
    """Code of a page.

    Attributes:
        place: page and line.
        code: text without its fence or indentation.
        reason: why it is not executed; empty if it is.
    """

    place: str
    code: str
    reason: str = ""


def blocks(language: str) -> list[Snippet]:
    """Return all fenced blocks of a language."""
    pattern = re.compile(
        rf"(?:<!-- not executed: (?P<reason>.+?) -->\n)?^```{language}\n(?P<code>.*?)^```$",
        re.MULTILINE | re.DOTALL,
    )
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in pattern.finditer(text):
            line = text.count("\n", 0, match.start("code"))
            place = f"{page.relative_to(ROOT)}:{line}"
            found.append(Snippet(place, match["code"], match["reason"] or ""))
    return found


def commands() -> Iterator[Snippet]:
    """Yield the commands of indented lines and inline code that call a program of this package."""
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
        for number, line in enumerate(text.splitlines(), start=1):
            codes = re.findall(r"`([^`]+)`", line)
            codes += [line.strip()] if line.startswith("    ") else []
            for code in codes:
                program, _, arguments = code.partition(" ")
                is_command = program in PROGRAMS and "──" not in code
                if not is_command or not (arguments or line.startswith("    ")):
                    continue
                if re.fullmatch(r"earthmoving [a-z]+|python -m [a-z_.]+", code):
                    code += " --help"  # named in a sentence, without its arguments
                yield Snippet(f"{page.relative_to(ROOT)}:{number}", code)


PYTHON = [each for each in blocks("python") if not each.reason]
CONTROLLERS = [each for each in PYTHON if "rclpy.spin(" in each.code]
TESTS = [each for each in PYTHON if "def test_" in each.code]
SCRIPTS = [each for each in PYTHON if each not in CONTROLLERS + TESTS]


def name_of(snippet: Any) -> str:
    return str(snippet.place)


def test_each_kind_of_snippet_is_found() -> None:
    assert CONTROLLERS
    assert TESTS
    assert SCRIPTS
    assert blocks("yaml")
    assert {each.code.split()[0] for each in commands()} == set(PROGRAMS)


@pytest.mark.parametrize("snippet", SCRIPTS, ids=name_of)
def test_python_block_runs_and_prints(
    snippet: Snippet,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    monkeypatch.chdir(tmp_path)
    exec(compile(snippet.code, snippet.place, "exec"), {})
    assert capsys.readouterr().out


@pytest.mark.parametrize("snippet", CONTROLLERS, ids=name_of)
def test_controller_moves_the_machine(ros: Ros, ros_process: StartProcess, snippet: Any) -> None:
    ros.add(SoilNode, parameters={"site.terrain": "flat", "site.num_points": 65})
    ros.add(MachineNode)
    states = ros.collect("/excavator/joint_states", JointState, STATE)
    ros.spin_until(lambda: states, what="joint states")
    initial = states[0].position
    ros_process([sys.executable, "-c", snippet.code])
    ros.spin_until(
        lambda: (
            states[-1].position[0] > initial[0] + 0.05
            and states[-1].position[1] < initial[1] - 0.03
        ),
        what="motion of swing and boom",
    )


@pytest.mark.parametrize("snippet", TESTS, ids=name_of)
def test_test_of_a_page_passes(tmp_path: Path, snippet: Snippet) -> None:
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["msg_bridge.testing.fixtures"]')
    (tmp_path / "test_it.py").write_text(snippet.code)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


def check_parameters(executable: str, values: Mapping[str, Any]) -> None:
    """Validate ROS parameters of a node executable by their full names.

    Raises:
        ParameterError: a name is unknown, or a value invalid.
    """
    groups = USAGES[executable].parameters
    by_prefix: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        prefix = max((each for each in groups if name.startswith(each)), key=len)
        by_prefix.setdefault(prefix, {})[name.removeprefix(prefix)] = value
    for prefix, group in by_prefix.items():
        groups[prefix].from_mapping(group)


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested mappings as one mapping of dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        is_group = isinstance(value, Mapping)
        flat |= flatten(value, f"{prefix}{name}.") if is_group else {prefix + name: value}
    return flat


def has_shapes(snippet: Snippet) -> bool:
    """Return whether a block of YAML describes the shapes of a machine."""
    return "view_points" in yaml.safe_load(snippet.code)


@pytest.mark.parametrize("snippet", filter(has_shapes, blocks("yaml")), ids=name_of)
def test_yaml_block_of_shapes_is_part_of_a_machine_file(snippet: Snippet, tmp_path: Path) -> None:
    machine = yaml.safe_load(find_config("machines/excavator.yaml").read_text(encoding="utf-8"))
    path, shapes = tmp_path / "machine.yaml", yaml.safe_load(snippet.code)
    path.write_text(yaml.safe_dump({**machine, "shapes": shapes}, sort_keys=False))
    assert sum(num_triangles([mesh]) for mesh in link_meshes(load_machine_spec(path)).values())


@pytest.mark.parametrize("snippet", filterfalse(has_shapes, blocks("yaml")), ids=name_of)
def test_yaml_block_is_a_valid_parameter_file(snippet: Snippet) -> None:
    for node, content in yaml.safe_load(snippet.code).items():
        check_parameters(node.rpartition("/")[2], flatten(content["ros__parameters"]))


def check_node_arguments(executable: str, arguments: list[str]) -> None:
    """Check options, parameters and parameter files of a node's command line."""
    if arguments in ([], ["--help"]):
        return
    assert arguments[0] == "--ros-args", arguments
    for option, value in zip(arguments[1::2], arguments[2::2], strict=True):
        name, _, content = value.partition(":=")
        if option == "-p":
            check_parameters(executable, {name: yaml.safe_load(content)})
        elif option == "--params-file":
            assert (ROOT / value).is_file(), value
        else:
            assert option in ("-r", "--enclave"), option
            assert content or option == "--enclave", value


class ArgumentsParsed(Exception):  # noqa: N818
    """Raised after a program has parsed its arguments, instead of running it."""


def check_exit(error: BaseException) -> None:
    """Assert that a program printed its help or parsed its arguments."""
    assert not isinstance(error, SystemExit) or error.code == 0, "invalid arguments"


def check_python_arguments(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a module or script up to the end of its `parse_args`."""
    is_module = arguments[0] == "-m"
    target, *options = arguments[1:] if is_module else arguments
    spec = find_spec(target) if is_module else None
    if spec is not None and spec.submodule_search_locations:
        spec = find_spec(f"{target}.__main__")
    path = Path(spec.origin or "") if spec else ROOT / target
    source = path.read_text(encoding="utf-8")
    if "parse_args()" not in source:
        assert path.parent.name != "examples", f"{target} does not use argparse"
        assert not options or "sys.argv" in source, f"{target} takes no arguments"
        assert not any(each.startswith("-") for each in options), f"{target} has no options"
        return
    parse_args = argparse.ArgumentParser.parse_args

    def parse_and_stop(parser: argparse.ArgumentParser) -> NoReturn:
        parse_args(parser)
        raise ArgumentsParsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_and_stop)
    monkeypatch.setattr(sys, "argv", [str(path), *options])
    monkeypatch.syspath_prepend(ROOT if is_module else path.parent)
    with pytest.raises((ArgumentsParsed, SystemExit)) as caught:
        runpy.run_path(str(path), run_name="__main__")
    check_exit(caught.value)


def check_ros2_arguments(arguments: list[str]) -> None:
    """Check a launch file, or the topic and type of `ros2 topic pub`."""
    if arguments[:2] == ["launch", "earthmoving_sim"]:
        assert (ROOT / "launch" / arguments[2]).is_file()
    if arguments[:2] == ["topic", "pub"]:
        topic, message_type, content = arguments[-3:]
        endpoint = next(each for each in INTERFACE if topic.endswith(f"/{each.name}"))
        assert message_type == endpoint.type
        package, _, name = message_type.split("/")
        message = getattr(import_module(f"{package}.msg"), name)
        assert set(yaml.safe_load(content)) <= set(message.get_fields_and_field_types())


def check_command(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that a program exists and accepts the options of a command."""
    program, *arguments = shlex.split(command, comments=True)
    if program == "earthmoving":
        try:
            build_parser().parse_args(arguments)
        except SystemExit as error:
            check_exit(error)
    elif program in USAGES:
        check_node_arguments(program, arguments)
    elif program == "python":
        check_python_arguments(arguments, monkeypatch)
    elif program == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert {each for each in arguments if "=" not in each} <= set(targets)
    elif program == "ros2":
        check_ros2_arguments(arguments)


@pytest.mark.parametrize("command", sorted({each.code for each in commands()}))
def test_command_has_valid_options(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    check_command(command, monkeypatch)


@pytest.mark.parametrize(
    "command",
    [
        "earthmoving demo --no-such-option",
        "earthmoving dem",
        "soil_sim --ros-args -p soil.no_such_parameter:=1",
        "soil_sim --ros-args -p soil.swell:=high",
        "machine_sim --params-file config/machine_sim.yaml",
        "python -m benchmarks.state_hashes compare --no-such-option",
        "python examples/stop_when_full.py --no-such-option",
        "python examples/ten_lines.py 1",
        "make no-such-target",
        "python examples/plot_volume_from_bag.py",
        "ros2 launch earthmoving_sim no_such_file.launch.py",
        "ros2 topic pub /excavator/joint_commands std_msgs/msg/String '{data: swing}'",
    ],
)
def test_invalid_command_is_found(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises((AssertionError, ParameterError)):
        check_command(command, monkeypatch)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_linked_files_and_pictures_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", text):
        assert (page.parent / target).exists(), target


def test_places_named_in_contributing_are_files() -> None:
    text = (ROOT / "docs/contributing.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| where .* \| (.*) \|$", text, re.MULTILINE)
    paths = [path for row in rows for path in re.findall(r"`([^`]+)`", row)]
    assert len(rows) == 12
    assert not [path for path in paths if not (ROOT / path).is_file()]

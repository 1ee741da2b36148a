"""`earthmoving check`: each check finds what is missing and gives advice."""

import argparse
import shutil
import sys
from collections import namedtuple
from pathlib import Path

import pytest

from earthmoving_sim.commands import check
from earthmoving_sim.environment import dependencies, resources, ros
from earthmoving_sim.environment.check_result import CheckResult, Status
from earthmoving_sim.environment.dependencies import Dependency
from earthmoving_sim.environment.probe import probe

OK = CheckResult("fine", Status.OK, "here")
WARNING = CheckResult("small", Status.WARNING, "tight", "get more")
MISSING = CheckResult("missing", Status.MISSING, "not here", "install it")


def run_with(monkeypatch: pytest.MonkeyPatch, *results: CheckResult) -> int:
    monkeypatch.setattr(check, "all_checks", lambda output: iter(results))
    return check.run(argparse.Namespace(output=Path("out")))


def rclpy_in(folder: Path) -> Path:
    (folder / "rclpy").mkdir(parents=True)
    (folder / "rclpy/__init__.py").touch()
    return folder


def test_exit_code_is_0_if_all_checks_pass(monkeypatch, capsys):
    assert run_with(monkeypatch, OK) == 0
    assert "Ready." in capsys.readouterr().out


def test_warning_is_printed_with_advice_and_exit_code_0(monkeypatch, capsys):
    assert run_with(monkeypatch, OK, WARNING) == 0
    out = capsys.readouterr().out
    assert "! small" in out
    assert "→ get more" in out


def test_missing_requirement_is_printed_with_advice_and_exit_code_1(monkeypatch, capsys):
    assert run_with(monkeypatch, MISSING, OK) == 1
    out = capsys.readouterr().out
    assert "✗ missing" in out
    assert "→ install it" in out
    assert "✓ fine" in out, "later checks are made"


@pytest.mark.parametrize("version", [(3, 9, 18), (3, 14, 0)])
def test_python_out_of_range_is_missing(monkeypatch, version):
    monkeypatch.setattr(sys, "version_info", version)
    result = dependencies.check_python()
    assert result.status is Status.MISSING
    assert "3.10 to 3.13" in result.advice


def test_dependency_that_is_not_installed_is_missing_with_how_to_install_it():
    result = dependencies.check_dependency(Dependency("no-such-package-here", "pass"))
    assert result.status is Status.MISSING
    assert "make setup" in result.advice
    assert "pip install -c constraints.txt no-such-package-here" in result.advice


def test_installed_dependency_that_does_not_work_is_missing_with_the_error():
    result = dependencies.check_dependency(
        Dependency("numpy", "raise OSError('bad libc')", "repair it")
    )
    assert result.status is Status.MISSING
    assert "OSError: bad libc" in result.detail
    assert result.advice == "repair it"


def test_dependency_that_crashes_the_interpreter_is_a_finding():
    crash = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    result = dependencies.check_dependency(Dependency("numpy", crash))
    assert result.status is Status.MISSING
    assert "SIGSEGV" in result.detail


def test_probe_that_hangs_is_a_finding():
    problem = probe("import time; time.sleep(60)", timeout=0.2)
    assert problem is not None
    assert "no answer" in problem


@pytest.mark.parametrize(
    "dependency", dependencies.DEPENDENCIES, ids=lambda each: each.distribution
)
def test_every_dependency_is_installed_by_the_requirements(dependency):
    requirements = (Path(__file__).parents[3] / "requirements.txt").read_text().splitlines()
    assert dependency.distribution in requirements


def test_missing_rclpy_has_advice_for_wheels_and_sourced_ros(monkeypatch):
    monkeypatch.setattr(sys, "path", [])
    result = ros.check_ros()
    assert result.status is Status.MISSING
    assert "source /opt/ros/jazzy/setup.bash" in result.advice
    assert "make setup" in result.advice


def test_sourced_ros_mixed_with_wheels_is_rejected(monkeypatch, tmp_path):
    sourced, wheels = rclpy_in(tmp_path / "opt"), rclpy_in(tmp_path / "venv")
    monkeypatch.setattr(sys, "path", [str(sourced), str(wheels)])
    result = ros.check_ros()
    assert result.status is Status.MISSING
    assert str(sourced) in result.detail
    assert str(wheels) in result.detail
    assert "must not mix" in result.advice


def test_one_rclpy_on_two_path_entries_is_accepted(monkeypatch, tmp_path):
    folder = rclpy_in(tmp_path / "opt")
    (tmp_path / "link").symlink_to(folder)
    monkeypatch.setattr(sys, "path", [str(folder), str(tmp_path / "link")])
    assert ros.rclpy_copies() == [folder]


def test_sourced_ros_of_another_distribution_is_rejected(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "path", [str(rclpy_in(tmp_path))])
    monkeypatch.setenv("ROS_DISTRO", "humble")
    result = ros.check_ros()
    assert result.status is Status.MISSING
    assert "humble" in result.detail
    assert "Jazzy" in result.advice


def test_ros_whose_messages_do_not_work_is_missing(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "path", [str(rclpy_in(tmp_path))])
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setattr(ros, "probe", lambda code: "ImportError: no sensor_msgs")
    result = ros.check_ros()
    assert result.status is Status.MISSING
    assert "no sensor_msgs" in result.detail


def test_missing_config_files_are_missing(monkeypatch):
    monkeypatch.setattr(resources, "shipped_configs", list)
    assert resources.check_config().status is Status.MISSING


def test_output_folder_that_does_not_exist_yet_is_fine_and_not_created(tmp_path):
    result = resources.check_output(tmp_path / "new/deeper")
    assert result.status is Status.OK
    assert list(tmp_path.iterdir()) == []


def test_output_folder_below_a_file_is_missing(tmp_path):
    (tmp_path / "file").touch()
    result = resources.check_output(tmp_path / "file/out")
    assert result.status is Status.MISSING
    assert "--output" in result.advice


def test_full_disk_is_a_warning(monkeypatch, tmp_path):
    usage = namedtuple("usage", "total used free")(100, 90, 10)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    assert resources.check_output(tmp_path).status is Status.WARNING


def test_little_memory_is_a_warning(tmp_path):
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal:  8000000 kB\nMemAvailable:   524288 kB\n")
    result = resources.check_memory(meminfo)
    assert result.status is Status.WARNING
    assert "512 MiB" in result.detail


def test_single_core_is_a_warning(monkeypatch):
    monkeypatch.setattr(resources.os, "sched_getaffinity", lambda pid: {0})
    assert resources.check_cores().status is Status.WARNING


def test_numba_pybullet_and_rclpy_work_in_this_environment():
    by_name = {each.distribution: each for each in dependencies.DEPENDENCIES}
    results = [dependencies.check_dependency(by_name[name]) for name in ("numba", "pybullet")]
    assert [str(result) for result in [*results, ros.check_ros()] if result.advice] == []

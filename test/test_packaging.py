"""A colcon workspace builds the package, and the installed package runs."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    *("soil_sim", "machine_sim", "msg_bridge", "dig_operator", "teleop", "viewer"),
    "earthmoving_sim",
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.independent,
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs the list of files from git"),
]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Path:
    """Return a built colcon workspace with a copy of this source."""
    folder = tmp_path_factory.mktemp("workspace")
    copy_source(folder / "src/earthmoving_sim")
    colcon = shutil.which("colcon", path=Path(sys.executable).parent) or shutil.which("colcon")
    assert colcon, "colcon is missing: run `make setup`"
    build = run([colcon, "build", "--event-handlers", "console_direct+"], folder)
    assert build.returncode == 0, build.stdout + build.stderr
    return folder


def copy_source(target: Path) -> None:
    """Copy all files that git tracks or would track, and add a config file two folders deep."""
    listed = run(["git", "ls-files", "-co", "--exclude-standard", "-z"], ROOT)
    assert listed.returncode == 0, listed.stderr
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():  # deleted files may be in the index
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    probe = target / "config/packaging_test/deep/probe.yaml"
    probe.parent.mkdir(parents=True)
    probe.write_text("probe: 1\n")


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def run_sourced(workspace: Path, command: str) -> subprocess.CompletedProcess[str]:
    """Run a shell command with the workspace sourced, from another folder."""
    script = f"source '{workspace}/install/setup.bash' && {command}"
    folder = workspace / "elsewhere"
    folder.mkdir(exist_ok=True)
    return run(["bash", "-c", script], folder)


def installed(workspace: Path) -> Path:
    return workspace / "install/earthmoving_sim"


def command_of(workspace: Path) -> Path:
    return installed(workspace) / "lib/earthmoving_sim/earthmoving"


def python_in(workspace: Path, code: str) -> subprocess.CompletedProcess[str]:
    return run_sourced(workspace, f"'{sys.executable}' -c \"{code}\"")


def test_package_is_registered_in_the_ament_index(workspace):
    share = installed(workspace) / "share"
    assert (share / "ament_index/resource_index/packages/earthmoving_sim").is_file()
    assert (share / "earthmoving_sim/package.xml").is_file()


def test_every_package_is_imported_from_the_workspace(workspace):
    for package in PACKAGES:
        done = python_in(workspace, f"import {package}; print({package}.__file__)")
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(str(installed(workspace))), done.stdout


def test_all_modules_and_no_tests_are_installed(workspace):
    source = {
        path.relative_to(ROOT).as_posix()
        for each in PACKAGES
        for path in (ROOT / each).rglob("*.py")
        if ROOT / "viewer/page" not in path.parents  # what builds the page
    }
    (site,) = installed(workspace).glob("lib/python3*/site-packages")
    modules = {
        path.relative_to(site).as_posix() for path in site.rglob("*.py") if path.name != "setup.py"
    }
    assert modules == source
    assert {"index.html", "main.js", "style.css"} <= {
        path.name for path in (site / "viewer/page/dist").iterdir()
    }


def test_config_file_is_found_in_share(workspace):
    code = (
        "from msg_bridge.config_files import find_config; "
        "print(find_config('packaging_test/deep/probe.yaml'))"
    )
    done = python_in(workspace, code)
    share = installed(workspace) / "share/earthmoving_sim/config"
    assert done.stdout.strip() == str(share / "packaging_test/deep/probe.yaml"), done.stderr


def test_installed_command_has_help(workspace):
    done = run_sourced(workspace, f"'{command_of(workspace)}' --help")
    assert done.returncode == 0, done.stderr
    assert "usage: earthmoving" in done.stdout


def test_installed_check_passes(workspace):
    done = run_sourced(workspace, f"'{command_of(workspace)}' check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert str(installed(workspace) / "share/earthmoving_sim/config") in done.stdout

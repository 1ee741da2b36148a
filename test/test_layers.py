"""Allowed imports between the packages: soil and machines use neither ROS nor each other."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Imports all of the package argv[1] except its node, in a Python without rclpy.
IMPORT_WITHOUT_ROS = """\
import importlib, pkgutil, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "rclpy":
            raise ImportError("rclpy is blocked by this test")

sys.meta_path.insert(0, NoRos())
package = importlib.import_module(sys.argv[1])

def stop(name):
    raise

for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".", onerror=stop):
    if ".node." not in module.name + ".":
        importlib.import_module(module.name)
"""

MAY_NOT_IMPORT = {
    "msg_bridge": {
        "soil_sim",
        "machine_sim",
        "dig_operator",
        "teleop",
        "viewer",
        "earthmoving_sim",
    },
    "soil_sim": {"machine_sim", "dig_operator", "teleop", "viewer", "earthmoving_sim"},
    "machine_sim": {"soil_sim", "dig_operator", "teleop", "viewer", "earthmoving_sim"},
    "dig_operator": {"soil_sim", "teleop", "viewer", "earthmoving_sim"},
    "teleop": {"soil_sim", "dig_operator", "viewer", "earthmoving_sim"},
    "viewer": {"soil_sim", "dig_operator", "earthmoving_sim"},
    "viewer/scene": {"rclpy", "aiohttp", "msgpack"},
    "viewer/server": {"rclpy"},
    "msg_bridge/contract": {"rclpy"},
    "msg_bridge/exchange": {"rclpy"},
}


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and top-level package of every absolute import, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name.split(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.lineno, node.module.split(".")[0]


def violations(paths: list[Path], forbidden: set[str]) -> list[str]:
    assert paths, "no files"
    return [
        f"{path.relative_to(ROOT)}:{line} imports {package}"
        for path in paths
        for line, package in imported(path)
        if package in forbidden
    ]


@pytest.mark.parametrize("package", ["soil_sim", "machine_sim"])
def test_pure_package_can_be_imported_without_ros(package):
    command = [sys.executable, "-c", IMPORT_WITHOUT_ROS, package]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("folder", MAY_NOT_IMPORT)
def test_package_imports_only_lower_layers(folder):
    assert violations(sorted((ROOT / folder).rglob("*.py")), MAY_NOT_IMPORT[folder]) == []


@pytest.mark.parametrize("package", ["soil_sim", "machine_sim"])
def test_only_the_node_of_a_pure_package_imports_rclpy(package):
    paths = [path for path in (ROOT / package).rglob("*.py") if path.parts[-2] != "node"]
    assert violations(sorted(paths), {"rclpy"}) == []


def test_all_forms_of_imports_are_found(tmp_path):
    source = tmp_path / "source.py"
    source.write_text(
        "import os.path as p, rclpy.node\n"
        "from rclpy import node\n"
        "from . import rclpy\n"
        "def late():\n    from soil_sim.excavation.swept_cut import cut\n"
    )
    packages = [package for _, package in imported(source)]
    assert sorted(packages) == ["os", "rclpy", "rclpy", "soil_sim"]

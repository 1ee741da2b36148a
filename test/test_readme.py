"""The code in the README runs unchanged."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.qos import STATE
from soil_sim.node.soil_node import SoilNode

README = Path(__file__).resolve().parents[1] / "README.md"
SOURCES = (README, README.parent / "docs" / "testing.md")
CODE = [
    code
    for path in SOURCES
    for code in re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
]
CONTROLLERS = [code for code in CODE if "rclpy.spin" in code]
TESTS = [code for code in CODE if "def test_" in code]
EXAMPLES = [code for code in CODE if code not in CONTROLLERS + TESTS]


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_runs(example: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(example, str(README), "exec"), {})
    assert capsys.readouterr().out


def test_readme_has_a_controller_a_test_and_examples() -> None:
    assert EXAMPLES
    assert len(CONTROLLERS) == len(TESTS) == 1


def test_controller_moves_the_machine(ros, ros_process) -> None:
    ros.add(SoilNode, parameters={"site.terrain": "flat", "site.num_points": 65})
    ros.add(MachineNode)
    states = ros.collect("/excavator/joint_states", JointState, STATE)
    ros.spin_until(lambda: states, what="joint states")
    initial = states[0].position
    ros_process([sys.executable, "-c", CONTROLLERS[0]])
    ros.spin_until(
        lambda: (
            states[-1].position[0] > initial[0] + 0.05
            and states[-1].position[1] < initial[1] - 0.03
        ),
        what="motion of swing and boom",
    )


def test_test_of_the_readme_passes(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["msg_bridge.testing.fixtures"]')
    (tmp_path / "test_it.py").write_text(TESTS[0])
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


def test_pictures_exist() -> None:
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README.read_text(encoding="utf-8")):
        assert (README.parent / path).is_file()

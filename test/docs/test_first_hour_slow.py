"""The commands of docs/first_hour.md run one after the other, as a reader types them."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from msg_bridge.codec.qos import STATE
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_process import RosProcess

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

ROOT = Path(__file__).resolve().parents[2]
NODES = ("exchange_recorder", "soil_sim", "machine_sim")  # run until section 5
CONTROLLER = "python examples/ten_lines.py"  # runs until Ctrl-C
KEYS = {"python examples/keyboard_drive.py": "i\nq"}  # input of a program


def first_hour_commands() -> list[str]:
    """Return the commands of the page in order, without comments."""
    text = re.sub(r"^```.*?^```$", "", (ROOT / "docs/first_hour.md").read_text(), flags=re.M | re.S)
    lines = re.findall(r"^    (\S.*)$", text, flags=re.M)
    return [shlex.join(shlex.split(line, comments=True)) for line in lines]


def run(command: str) -> str:
    """Run a command to its end and return its output."""
    done = subprocess.run(
        shlex.split(command),
        input=KEYS.get(command, ""),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}"
    return done.stdout


@pytest.fixture
def reader_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Enter a folder with the examples, with the programs of this environment in PATH."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def test_commands_of_the_first_hour_run_in_order(
    ros: Ros, ros_process: StartProcess, reader_folder: Path
) -> None:
    states = ros.collect("/excavator/joint_states", JointState, STATE)
    nodes: list[RosProcess] = []
    outputs: dict[str, str] = {}
    for command in first_hour_commands():
        words = shlex.split(command)
        if words[0] == "ros2" and shutil.which("ros2") is None:
            continue
        if words[0] in NODES:
            nodes.append(ros_process(words))
        elif words[:2] == shlex.split(CONTROLLER) or words[0] == "ros2":
            ros.spin_until(lambda: states, what="joint states", timeout=120.0)
            swing = states[-1].position[0]
            controller = ros_process(words)
            ros.spin_until(
                lambda: states[-1].position[0] > swing + 0.1,  # noqa: B023
                what="swing",
                timeout=60.0,
            )
            controller.stop(expect=None)
        else:
            if words[:2] == ["earthmoving", "audit"]:
                while nodes:
                    nodes.pop(0).stop()
            outputs[command] = run(command)

    assert {words.split()[0] for words in outputs} == {"python", "earthmoving"}
    (fill,) = re.findall(
        r"^bucket (\d+) % full$", outputs["python examples/stop_when_full.py"], re.M
    )
    assert int(fill) >= 80
    assert "Passed" in outputs["earthmoving audit bags/mine"]
    assert (reader_folder / "out/volume.png").is_file()

"""The example scripts run, and do what their docstrings say."""

from __future__ import annotations

import ast
import importlib.util
import itertools
import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
from dataclasses import fields
from pathlib import Path
from types import ModuleType

import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from support.recorded_messages import Recording

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.machine_state import PayloadState, to_payload_array
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.codec.tick_headers import to_multi_array
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import CONVERSION, empty_rows
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode
from soil_sim.terrain import load_terrain

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
COMMANDS = "/excavator/joint_commands"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_docstring_has_the_command_that_runs_the_example(path: Path) -> None:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert f"python examples/{path.name}" in (docstring or "")
    assert path.name in (EXAMPLES / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_help_of_each_example_is_printed_quickly(path: Path) -> None:
    command = [sys.executable, str(path), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
    assert done.stdout.startswith("usage: ")


@pytest.mark.parametrize(
    ("name", "arguments", "error"),
    [
        ("plot_volume_from_bag", ["nosuch"], "there is no bag nosuch"),
        ("plot_volume_from_bag", ["bags/format_2"], "has no payload of a machine"),
        ("analyse_bags", ["nosuch"], "there is no bag nosuch"),
        ("stop_when_full", ["--fill", "9"], "--fill is 9; give more than 0, and at most 1"),
    ],
)
def test_invalid_input_is_reported_in_one_line(name: str, arguments: list[str], error: str) -> None:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=EXAMPLES.parent)
    assert done.returncode in (1, 2)
    assert error in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_keyboard_drive_prints_its_keys_at_the_start(ros_domain: int) -> None:
    command = [sys.executable, str(EXAMPLES / "keyboard_drive.py")]
    done = subprocess.run(command, input="wq", capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    for key in load("keyboard_drive").KEYS:
        assert f" {key} " in done.stdout


def test_keyboard_drive_stops_when_it_is_suspended_and_reads_keys_when_it_continues(
    ros: Ros,
) -> None:
    commands = ros.collect(COMMANDS, JointState)
    master, terminal = pty.openpty()
    shell_mode = termios.tcgetattr(terminal)
    command = [sys.executable, str(EXAMPLES / "keyboard_drive.py")]
    process = subprocess.Popen(command, stdin=terminal, stdout=subprocess.DEVNULL)

    def moves_by_key() -> bool:
        os.write(master, b"j")  # again: what was typed before the terminal's mode is set is dropped
        return any(commands[-1].velocity)

    try:
        ros.spin_until(lambda: commands)
        os.write(master, b"j")
        ros.spin_until(lambda: any(commands[-1].velocity))
        process.send_signal(signal.SIGTSTP)
        ros.spin_until(lambda: not any(commands[-1].velocity))
        os.waitid(os.P_PID, process.pid, os.WSTOPPED)
        count = len(commands)
        termios.tcsetattr(terminal, termios.TCSANOW, shell_mode)
        process.send_signal(signal.SIGCONT)
        ros.spin_until(lambda: len(commands) > count + 5)
        assert not any(any(message.velocity) for message in commands[count:])
        ros.spin_until(moves_by_key)
        os.write(master, b"q")
        ros.spin_until(lambda: process.poll() is not None)
    finally:
        process.kill()
        process.wait()
        os.close(terminal)
        os.close(master)
    assert process.returncode == 0


def test_ten_lines_publishes_velocities(ros: Ros, ros_process: StartProcess) -> None:
    commands = ros.collect(COMMANDS, JointState)
    process = ros_process([sys.executable, EXAMPLES / "ten_lines.py"])
    ros.spin_until(lambda: len(commands) >= 3)
    process.stop(signal.SIGTERM)
    assert process.output == ""
    assert dict(zip(commands[-1].name, commands[-1].velocity, strict=True)) == {
        "swing": 0.2,
        "boom": -0.1,
    }


def test_stop_when_full_fills_the_bucket_from_the_home_pose(
    ros: Ros, ros_process: StartProcess
) -> None:
    ros.add(SoilNode, parameters={"site.terrain": "flat", "site.num_points": 129})
    ros.add(MachineNode)
    commands = ros.collect(COMMANDS, JointState)
    process = ros_process([sys.executable, EXAMPLES / "stop_when_full.py", "--fill", "0.5"])
    ros.spin_until(lambda: not process.running, what="a full bucket", timeout=120.0)
    process.wait()
    (fill,) = re.findall(r"^bucket (\d+) % full$", process.output, re.MULTILINE)
    assert int(fill) >= 50
    ros.spin_until(lambda: not any(commands[-1].velocity), what="zero velocities")


def test_stop_when_full_gives_a_reason_when_the_joints_do_not_move(
    ros: Ros, ros_process: StartProcess
) -> None:
    process = ros_process([sys.executable, EXAMPLES / "stop_when_full.py"])
    joints = ros.publisher("/excavator/joint_states", JointState, subscriptions=1)
    joints.publish(JointState(name=["boom", "arm", "bucket"], position=[0.85, 2.6, 2.3]))
    payload = ros.publisher("/excavator/payload", Float64MultiArray, subscriptions=1)
    seconds = itertools.count()

    def has_ended() -> bool:
        payload.publish(to_payload_array(PayloadState(0.0, 0.0, 0.0, 0.0, float(next(seconds)))))
        return not process.running

    ros.spin_until(has_ended, what="the end of the script")
    process.wait(expect=1)
    assert "the joints are at a limit" in process.output


def test_stop_when_full_stops_the_machine_when_it_is_terminated(
    ros: Ros, ros_process: StartProcess
) -> None:
    commands = ros.collect(COMMANDS, JointState)
    process = ros_process([sys.executable, EXAMPLES / "stop_when_full.py"])
    joints = ros.publisher("/excavator/joint_states", JointState, subscriptions=1)
    joints.publish(JointState(name=["boom", "arm", "bucket"], position=[0.85, 2.6, 2.3]))
    payload = ros.publisher("/excavator/payload", Float64MultiArray, subscriptions=1)
    payload.publish(to_payload_array(PayloadState(0.0, 0.0, 0.0, 0.0, 0.0)))
    ros.spin_until(lambda: commands, what="a command")
    process.stop(signal.SIGTERM, expect=1)
    assert "Traceback" not in process.output
    ros.spin_until(lambda: list(commands[-1].velocity) == 3 * [0.0], what="zero velocities")


def test_reset_run_calls_both_services(ros: Ros, ros_process: StartProcess) -> None:
    calls: list[str] = []

    def serve(name: str) -> None:
        def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            calls.append(name)
            response.success = True
            return response

        ros.helper.create_service(Trigger, name, answer)

    serve("/sim/reset")
    serve("/soil/verify")
    process = ros_process([sys.executable, EXAMPLES / "reset_run.py"])
    ros.spin_until(lambda: not process.running if len(calls) == 2 else False)
    process.wait()
    assert calls == ["/sim/reset", "/soil/verify"]


def test_keys_set_velocities_and_space_stops() -> None:
    drive = load("keyboard_drive")
    velocities = dict(drive.STOPPED)
    for key in "wi?":
        velocities = drive.update(velocities, key)
    message = drive.to_message(velocities)
    command = dict(zip(message.name, message.velocity, strict=True))
    assert (command["left_track"], command["boom"], command["swing"]) == (0.8, -0.2, 0.0)
    assert drive.update(velocities, " ") == drive.STOPPED


def test_own_terrain_rises_toward_x_with_its_heap_at_positive_y(tmp_path: Path) -> None:
    path = tmp_path / "ramp.npz"
    run("own_terrain", path)
    terrain = load_terrain(path)
    grid = terrain.grid

    def height(x: float, y: float) -> float:
        return float(terrain.heights[round(grid.row(x)), round(grid.col(y))])

    assert height(10.0, -5.0) - height(-10.0, -5.0) == pytest.approx(1.0, abs=0.02)
    assert height(5.0, 12.0) - height(5.0, -12.0) == pytest.approx(1.5, abs=0.1)


def test_plot_volume_from_bag_draws_the_payload_of_any_machine(tmp_path: Path) -> None:
    recording = Recording()
    for tick in range(5):
        volume = tick * 10**8
        ledger = Ledger(
            **{
                **dict.fromkeys((field.name for field in fields(Ledger)), 0),
                "tick": tick,
                "terrain": 10**12 - volume,
                "particles": volume,
                "start": 10**12,
            }
        )
        payload = PayloadState(
            1e-9 * volume, 1.2e-9 * volume, 160.0 * tick, 0.1 * tick, 0.01 * tick
        )
        recording.add("/soil/ledger", to_multi_array(ledger))
        for machine in ("/digger", "/site/dumper"):
            recording.add(f"{machine}/payload", to_payload_array(payload))
    bag, picture = recording.write_folder(tmp_path / "bag"), tmp_path / "volume.png"
    output = run("plot_volume_from_bag", bag, picture).stdout
    assert "/digger, /site/dumper; 5 ticks, imbalance 0 mm3" in output
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_analyse_bags_prints_volumes_and_cycles_of_each_bag() -> None:
    bags = [EXAMPLES.parent / "bags" / name for name in ("format_1", "format_2")]
    output = run("analyse_bags", *bags).stdout
    assert output.count("6.516242042") == 2  # m3, as the audit has them
    assert output.count("34.45") == 2  # m3/h
    assert output.count("boom") == 2


def test_analyse_bags_separates_the_machines_of_a_node_with_several(tmp_path: Path) -> None:
    recording = Recording()
    rows = empty_rows(CONVERSION, 1)
    rows["seq"], rows["volume_mm3"] = 1, 10**9
    chunk = RowChunk(7, Stream.CONVERSION, 0, 0, rows)
    recording.add("/soil/conversions", to_chunk_cloud(chunk, "map", Time()))
    for machine, report in (
        ("digger", {"planned_volume": 1.5, "moved_volume": 0.7, "duration": 17.0}),
        ("truck", {"moved_volume": 2.8, "duration": 153.0, "loading_time": 82.0}),
    ):
        recording.add(f"/site/{machine}/operator/cycles", String(data=json.dumps(report)))
        for sec in (1, 2):
            state = JointState(name=["boom"], position=[0.0], velocity=[0.5], effort=[1000.0])
            state.header.stamp = Time(sec=sec)
            recording.add(f"/site/{machine}/joint_states", state)
    output = run("analyse_bags", recording.write(tmp_path / "bag.mcap")).stdout
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    assert ["bag", "site/digger", "1", "17.0", "0.7"] in [each[:5] for each in cells]
    assert ["bag", "site/truck", "1", "153.0", "2.8"] in [each[:5] for each in cells]
    for machine in ("digger", "truck"):
        assert ["bag", f"site/{machine}", "boom", "0.5"] in cells

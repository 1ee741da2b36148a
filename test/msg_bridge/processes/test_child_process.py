"""ChildProcess: output, exit codes, signals, and the end with the parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from msg_bridge.processes import ChildProcess, python_module_command

WAIT = "import time; print('started', flush=True); time.sleep(60)"


def start(tmp_path: Path, code: str) -> ChildProcess:
    return ChildProcess([sys.executable, "-c", code], tmp_path / "log.txt")


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_output_and_exit_code_are_those_of_the_program(tmp_path: Path) -> None:
    process = start(tmp_path, "import sys; print('a'); print('b', file=sys.stderr); sys.exit(3)")
    assert process.wait(30.0) == process.exit_code == 3
    assert sorted(process.output.split()) == ["a", "b"]
    assert process.tail(1).startswith("    ")


def test_running_process_has_no_exit_code_until_it_is_killed(tmp_path: Path) -> None:
    process = start(tmp_path, WAIT)
    assert process.exit_code is None
    assert process.wait(0.01) is None
    assert process.kill() == process.exit_code == -signal.SIGKILL


def test_python_module_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    (tmp_path / "waiting.py").write_text(WAIT)
    code = (
        "import pathlib, time\n"
        "from msg_bridge.processes import ChildProcess, python_module_command\n"
        "child = ChildProcess(python_module_command('waiting'), pathlib.Path('child.txt'))\n"
        "while 'started' not in child.output: time.sleep(0.02)\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    parent = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert is_running(pid)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 10.0
    while is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not is_running(pid)


@pytest.mark.parametrize(
    "command",
    [python_module_command("waiting"), [sys.executable, "-m", "waiting"]],
    ids=["module", "program"],
)
def test_child_can_be_interrupted_when_its_parent_ignores_sigint(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "waiting.py").write_text(WAIT)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        process = ChildProcess(command, tmp_path / "log.txt")
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    while "started" not in process.output and process.exit_code is None:
        time.sleep(0.02)
    process.interrupt()
    assert process.wait(30.0) == -signal.SIGINT
    assert "KeyboardInterrupt" in process.output


def test_module_is_not_run_when_its_parent_is_already_dead(tmp_path: Path) -> None:
    command = python_module_command("this")
    command[command.index(str(os.getpid()))] = "1"
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[3])
    assert (done.returncode, done.stdout) == (1, "")


def test_program_in_place_of_a_module_has_its_arguments_and_exit_code(tmp_path: Path) -> None:
    program = ["/bin/sh", "-c", "echo $1; exit 4", "sh", "hello"]
    command = python_module_command("msg_bridge.processes.exec_program", program)
    process = ChildProcess(command, tmp_path / "log.txt")
    assert process.wait(30.0) == 4
    assert process.output == "hello\n"

"""Programs whose output is no longer read, as with `| head`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]

PROGRAM = """\
import os, sys
from msg_bridge.processes.broken_pipe import end_on_broken_pipe

def program():
    {}
    return 0

sys.exit(end_on_broken_pipe(program))
"""
OTHER_PIPE = "r, w = os.pipe(); os.close(r); os.write(w, b'text')"


def run_without_reader(*command: str, closed: str = "stdout") -> tuple[int, str]:
    """Run a program whose output has no reader; return exit code and text of the other stream."""
    reader, writer = os.pipe()
    os.close(reader)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, closed: writer}
    # Without a buffer, argparse ignores the error when it prints.
    env = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    try:
        done = subprocess.run([sys.executable, *command], cwd=ROOT, env=env, text=True, **streams)
    finally:
        os.close(writer)
    return done.returncode, (done.stdout or "") + (done.stderr or "")


@pytest.mark.parametrize(
    "command",
    [
        ("-m", "earthmoving_sim", "--help"),
        ("-m", "earthmoving_sim", "export", "--help"),
        ("-m", "soil_sim.node.soil_node", "--help"),
        ("-c", PROGRAM.format("print('short')")),
        ("-c", PROGRAM.format("print('long ' * 100_000)")),
        ("-c", PROGRAM.format("print('unbuffered', flush=True)")),
    ],
)
def test_program_ends_quietly_when_its_output_is_not_read(command: tuple[str, ...]) -> None:
    assert run_without_reader(*command) == (1, "")


def test_program_ends_quietly_when_its_errors_are_not_read() -> None:
    program = PROGRAM.format("print('text', file=sys.stderr)")
    assert run_without_reader("-c", program, closed="stderr") == (1, "")


def test_broken_pipe_to_another_process_is_raised() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(OTHER_PIPE)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "BrokenPipeError" in done.stderr


def test_program_whose_output_is_read_keeps_its_exit_code() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format("print('text'); return 7")],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (7, "text\n", "")

"""NodeProcess: nodes that end unexpectedly, that wait, and that are stopped."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from earthmoving_sim.multi_process.node_process import (
    NodeProcess,
    NodeProcessError,
    describe_logs,
    stop_all,
    waiting_reasons,
)

StartNode = Callable[[str], NodeProcess]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StartNode:
    """Return a function that runs code as a node and waits for its first output."""

    def start(code: str) -> NodeProcess:
        (tmp_path / "fake_node.py").write_text(code)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
        process = NodeProcess("fake", "fake_node", [], tmp_path / "fake.log")
        while not process.output and process.exit_code is None:
            time.sleep(0.02)
        return process

    return start


def test_node_that_ended_is_reported_with_the_end_of_its_output(start: StartNode) -> None:
    process = start("print('no licence'); raise SystemExit(4)")
    process.wait(30.0)
    with pytest.raises(NodeProcessError, match=r"exit code 4(.|\n)*no licence"):
        process.check()


def test_reason_of_a_wait_is_that_of_the_last_line(start: StartNode) -> None:
    wait = "print('waiting for subscribers of /terrain/map', flush=True)"
    process = start(f"import time; {wait}; time.sleep(60)")
    process.check()
    assert waiting_reasons([process]) == ["fake is waiting for subscribers of /terrain/map"]
    assert "subscribers of /terrain/map" in describe_logs([process])
    process.kill()


def test_node_that_compiles_is_reported_with_its_progress(start: StartNode) -> None:
    line = "[INFO] [soil_sim]: compiling kernels: 3 of 90, 2 s"
    process = start(f"import time; print('{line}', flush=True); time.sleep(60)")
    assert waiting_reasons([process]) == ["fake is compiling kernels: 3 of 90, 2 s"]
    process.kill()


def test_node_that_runs_has_no_reason_to_wait(start: StartNode) -> None:
    process = start("import time; print('waiting for x\\ntick 1', flush=True); time.sleep(60)")
    assert waiting_reasons([process]) == []
    process.kill()


@pytest.mark.parametrize(("code", "num_problems"), [(0, 0), (5, 1)])
def test_stop_reports_nodes_that_end_with_an_error(
    start: StartNode, code: int, num_problems: int
) -> None:
    process = start(
        "import time\nprint('[ERROR] imbalance of 3 mm3', flush=True)\ntry:\n    time.sleep(60)\n"
        f"except KeyboardInterrupt:\n    raise SystemExit({code})"
    )
    problems = stop_all([process])
    assert len(problems) == num_problems
    assert all("0 s: imbalance of 3 mm3; its output" in problem for problem in problems)
    assert process.exit_code == code


def test_node_that_does_not_end_is_killed_and_its_calls_are_reported(start: StartNode) -> None:
    code = (
        "import signal, time\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "def wait_for_disk():\n    time.sleep(60)\nprint('started', flush=True)\nwait_for_disk()"
    )
    process = start(code)
    (problem,) = stop_all([process], timeout=0.1)
    assert "did not end within" in problem
    assert "in wait_for_disk" in problem

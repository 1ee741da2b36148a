"""The demo as a user runs it, with its default settings."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from msg_bridge.audit import audit_bag
from msg_bridge.testing.ros_domain import reserve_domain

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

ROOT = Path(__file__).parents[3]
STATE = re.compile(r"state +([0-9a-f]{64}) after tick (\d+)")
CYCLE = re.compile(r"^ *(\d+) +(\d+) +([\d.]+) +(\d+) +(\d+) +([\d.]+) +([\d.]+)$", re.MULTILINE)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Finished process and folder of a demo with four nodes in a domain of their own."""
    folder = tmp_path_factory.mktemp("demo")
    with reserve_domain() as domain:
        return run_demo(folder, domain), folder


@pytest.fixture(scope="module")
def in_process(tmp_path_factory):
    """Finished process of a demo in one process."""
    return run_demo(tmp_path_factory.mktemp("in_process"), 0, "--in-process", "--no-pictures")


def run_demo(folder, domain, *options):
    command = [sys.executable, "-m", "earthmoving_sim", "demo", *options]
    env = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=850, env=env)


def test_demo_succeeds(demo):
    done, _ = demo
    assert done.returncode == 0, done.stdout + done.stderr


def test_audit_of_the_bag_passes(demo):
    (bag,) = (demo[1] / "bags").iterdir()
    report = audit_bag(bag)
    assert report.passed, report.findings
    assert [run.max_imbalance_mm3 for run in report.runs] == [0]
    assert report.runs[0].ticks > 5_000


def test_nodes_and_one_process_end_in_the_same_state(demo, in_process):
    states = [STATE.search(done.stdout).groups() for done in (demo[0], in_process)]
    assert states[0] == states[1]


@pytest.mark.parametrize("page", ["README.md", "docs/quickstart.md"])
def test_document_states_the_simulated_time(in_process, page):
    (run_time,) = re.findall(r"in ([\d.]+) s of simulated time", in_process.stdout)
    stated = re.findall(r"([\d.]+) s of simulated time", (ROOT / page).read_text("utf-8"))
    # Processors that round sums in another order give slightly other times.
    assert [float(time) for time in stated] == pytest.approx([float(run_time)], rel=0.05)


def test_demo_is_balanced_at_every_tick(demo):
    done, _ = demo
    assert re.search(r"imbalance +0 mm3 at worst", done.stdout)
    imbalances = set(re.findall(r"imbalance +(-?\d+) mm3", done.stdout))
    assert imbalances == {"0"}


def test_demo_moves_five_bucketfuls_and_empties_each(demo):
    cycles = CYCLE.findall(demo[0].stdout)
    assert [int(cycle[0]) for cycle in cycles] == [1, 2, 3, 4, 5]
    assert max(float(cycle[5]) for cycle in cycles) <= 2.0


def test_demo_fills_its_bucket_in_every_cycle(demo):
    for _, passes, _, carried, *_ in CYCLE.findall(demo[0].stdout):
        assert int(carried) >= 60 or int(passes) == 3, "too little after the maximum of passes"


def test_no_particle_tunnels_in_the_demo(demo):
    assert re.search(r"particles \d+ at most, 0 tunnelled", demo[0].stdout)


def test_demo_draws_three_pictures(demo):
    _, folder = demo
    pictures = sorted((folder / "out" / "demo").glob("*.png"))
    assert [path.name for path in pictures] == ["bucket_path.png", "cut_fill.png", "site.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_interrupted_or_killed_demo_leaves_no_node(number, tmp_path):
    with reserve_domain() as domain:
        command = [sys.executable, "-u", "-m", "earthmoving_sim", "demo", "--out", str(tmp_path)]
        demo = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            # A test run in the background of a shell ignores SIGINT, and children inherit that.
            preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        )
        assert demo.stdout is not None
        assert any(line.startswith("cycle") for line in demo.stdout), "there was no tick"
        assert len(processes_of(tmp_path)) == 5
        demo.send_signal(number)
        demo.stdout.read()
        is_killed = number == signal.SIGKILL
        assert demo.wait(timeout=60) == (-signal.SIGKILL if is_killed else 130)
        deadline = time.monotonic() + (30.0 if is_killed else 0.0)
        while processes_of(tmp_path) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert processes_of(tmp_path) == []
    (bag,) = (tmp_path / "bags").iterdir()
    assert (bag / "metadata.yaml").exists(), "the bag was closed"


def processes_of(folder):
    """Return the ids of processes whose command line contains a folder."""
    pids = []
    for each in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if str(folder) in each.read_text():
                pids.append(int(each.parent.name))
    return pids

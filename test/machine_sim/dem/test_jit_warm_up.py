"""Warm-up: no step after it compiles a kernel."""

import os
import subprocess
import sys

import pytest

from msg_bridge.kernels.fixed_signature import CHECK_VARIABLE

# Lists the kernels that Numba compiles or loads while soil is carried, poured and disturbed.
PROBE = """\
import numpy as np
from numba.core import dispatcher
from machine_sim.ground.contact_surface import Ground
from machine_sim.dem import ParticleEngine, ParticleParams, warm_up
from machine_sim.dem.sleep import ASLEEP_ON_MAP, FIRST_LOCKED_TOOL
from msg_bridge.contract.grid import Grid

params = ParticleParams(threads=THREADS)
warm_up(params)
compiled = []
compile_kernel = dispatcher.Dispatcher.compile
dispatcher.Dispatcher.compile = lambda self, sig: compiled.append(self) or compile_kernel(self, sig)
engine = ParticleEngine(params, Ground(Grid(40, 40, 0.25), np.zeros((40, 40))))
w, h = 0.4, 0.6
corners = [(-w, -w), (w, -w), (w, w), (-w, w)]
edges = zip(corners, corners[1:] + corners[:1])
sides = [[(*a, 0), (*b, 0), (*b, h), (*a, h)] for a, b in edges]
pose = (np.eye(3), np.array([0, 0, 0.5]))
engine.add_tool(0, [[(*corner, 0) for corner in corners], *sides], pose)
points = np.random.default_rng(1).uniform(-1, 1, (80, 3)) * [0.3, 0.3, 0.2] + [0, 0, 0.8]
engine.add(points, np.zeros_like(points), 500_000)
engine.add(points + [1.2, 0, -0.6], np.zeros_like(points), 500_000)
max_locked = max_asleep = 0
angle = 0.0
for k in range(900):
    if k > 550:
        angle += 0.01 if angle < 2.5 else 0.0
    c, s = np.cos(angle), np.sin(angle)
    origin = np.array([0.002 * max(k - 500, 0), 0, 0.5])
    end = (np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), origin)
    engine.set_tool_motion(0, pose, end)
    pose = end
    if k == 450:
        engine.add([[1.2, 0, 1.5]], [[0, 0, -3]], 500_000)
        engine.ground.set_heights(np.array([20]), np.array([15]), np.array([0.05]))
    engine.step(0.005)
    max_locked = max(max_locked, int((engine.sleep_states >= FIRST_LOCKED_TOOL).sum()))
    max_asleep = max(max_asleep, int((engine.sleep_states == ASLEEP_ON_MAP).sum()))
    if k > 850:
        ids = engine.settled()
        engine.freeze(ids[:2])
        engine.remove(ids[:2])
assert max_locked > 50 and max_asleep > 20, (max_locked, max_asleep)
assert engine.count < 161
print(*(kernel.py_func.__name__ for kernel in compiled))
"""


@pytest.mark.parametrize("threads", [1, 2])
def test_no_kernel_is_compiled_after_the_warm_up(threads):
    code = PROBE.replace("THREADS", str(threads))
    # With one thread as users run it: other tests check the types of the arguments of kernels.
    env = {**os.environ, CHECK_VARIABLE: "" if threads == 1 else "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""

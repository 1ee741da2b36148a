"""After the warm-up no step compiles anything."""

import subprocess
import sys

import pytest

# Counts what Numba compiles or loads while soil is carried, poured, disturbed and settles.
PROBE = """\
import numpy as np
from numba.core import dispatcher
from machine_sim.ground.contact_surface import Ground
from machine_sim.dem import ParticleEngine, ParticleParams, warm_up
from msg_bridge.contract.grid import Grid

params = ParticleParams(threads=THREADS)
warm_up(params)
compiled = []
compile_it = dispatcher.Dispatcher.compile
dispatcher.Dispatcher.compile = lambda self, sig: compiled.append(self) or compile_it(self, sig)
engine = ParticleEngine(params, Ground(Grid(40, 40, 0.25), np.zeros((40, 40))))
w, h = 0.4, 0.6
edge = [(-w, -w), (w, -w), (w, w), (-w, w)]
sides = [[(*a, 0), (*b, 0), (*b, h), (*a, h)] for a, b in zip(edge, edge[1:] + edge[:1])]
engine.add_tool(0, [[(*c, 0) for c in edge], *sides], (np.eye(3), np.array([0, 0, 0.5])))
at = np.random.default_rng(1).uniform(-1, 1, (80, 3)) * [0.3, 0.3, 0.2] + [0, 0, 0.8]
engine.add(at, np.zeros_like(at), 500_000)
beside = at + [1.2, 0, -0.6]
engine.add(beside, np.zeros_like(beside), 500_000)
carried = asleep = 0
angle, pose = 0.0, (np.eye(3), np.array([0, 0, 0.5]))
for k in range(900):
    if k > 550:
        angle += 0.01 if angle < 2.5 else 0.0
    c, s = np.cos(angle), np.sin(angle)
    at = np.array([0.002 * max(k - 500, 0), 0, 0.5])
    end = (np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), at)
    engine.set_tool_motion(0, pose, end)
    pose = end
    if k == 450:
        engine.add([[1.2, 0, 1.5]], [[0, 0, -3]], 500_000)
        engine.ground.set_heights(np.array([20]), np.array([15]), np.array([0.05]))
    engine.step(0.005)
    carried = max(carried, int((engine.state.sleep_state > 1).sum()))
    asleep = max(asleep, int((engine.state.sleep_state == 1).sum()))
    if k > 850:
        ids = engine.settled()
        engine.freeze(ids[:2])
        engine.remove(ids[:2])
assert carried > 50 and asleep > 20, (carried, asleep)
assert engine.count < 161
print(*(kernel.py_func.__name__ for kernel in compiled))
"""


@pytest.mark.parametrize("threads", [1, 2])
def test_nothing_is_compiled_after_the_warm_up(threads):
    code = PROBE.replace("THREADS", str(threads))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "", "compiled only now"

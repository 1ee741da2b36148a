"""After the warm-up no tick compiles anything."""

import subprocess
import sys

import pytest

# Counts what Numba compiles or loads while a terrain is dug and filled, after a warm-up.
PROBE = """\
import numpy as np
from numba.core import dispatcher
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import LANDED, SWEEP, Action, empty_rows
from soil_sim.soil_inventory import SoilInventory
from soil_sim.soils.params import SoilParams
from soil_sim.soil import Soil
from soil_sim.warm_up import warm_up

params = SoilParams(cut_mode=CUT_MODE)
warm_up(params)
compiled = []
compile_it = dispatcher.Dispatcher.compile
dispatcher.Dispatcher.compile = lambda self, sig: compiled.append(self) or compile_it(self, sig)
grid = Grid(64, 64, 0.2)
soil = Soil(grid, np.random.default_rng(1).random(grid.shape), params)
for tick in range(1, 30):
    sweeps = empty_rows(SWEEP, 20)
    sweeps["pair"] = (0, 0, 1, 1, 2, 2, 0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4)
    sweeps["tool"][6:], sweeps["action"][6:] = 1, Action.PRESS
    sweeps["y0"] = sweeps["y1"] = (0.5, -0.5) * 10
    sweeps["z0"][:10] = (0.0, 0.0, 0.3, 0.3, 0.6, 0.6, 0.0, 0.0, 0.3, 0.3)
    sweeps["x0"], sweeps["x1"] = 0.05 * tick, 0.05 * (tick + 1)
    drum, around = sweeps[10:], np.repeat(np.linspace(0.0, 2.0 * np.pi, 5), 2)
    drum["tool"], drum["action"] = 2, Action.MILL if tick % 2 else Action.CUT
    drum["x0"] += 0.4 * np.cos(around)
    drum["x1"] += 0.4 * np.cos(around + 0.1)
    drum["z0"], drum["z1"] = 0.4 * np.sin(around), 0.4 * np.sin(around + 0.1)
    sweeps["z1"][:10] = sweeps["z0"][:10]
    landed = empty_rows(LANDED, 3)
    landed["volume_mm3"], landed["particle_id"] = 50_000_000, 3 * tick + np.arange(3)
    moved = soil.step(tick, sweeps, landed)
    SoilInventory().record_conversions(moved.conversions)
    soil.state_hash()
assert moved.map_updates.size
print(*(kernel.py_func.__name__ for kernel in compiled))
"""


@pytest.mark.parametrize("cut_mode", ["swept", "reference"])
def test_nothing_is_compiled_after_the_warm_up(cut_mode):
    code = PROBE.replace("CUT_MODE", repr(cut_mode))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "", "compiled only now"

"""No tick compiles anything after the warm-up, and no cached kernel brings the machines with it."""

import subprocess
import sys

import pytest

# Prints the kernels that Numba compiles or loads while soil is dug and filled, after a warm-up.
PROBE = """\
import sys

import numpy as np
from numba.core import dispatcher
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, SweepAction, empty_rows
from soil_sim.soil_inventory import SoilInventory
from soil_sim.soils.params import SoilParams
from soil_sim.soil import Soil
from soil_sim.warm_up import warm_up

params = SoilParams(cut_mode=CUT_MODE)
warm_up(params)
compiled = []
compile_kernel = dispatcher.Dispatcher.compile
dispatcher.Dispatcher.compile = lambda self, sig: compiled.append(self) or compile_kernel(self, sig)
grid = Grid(64, 64, 0.2)
soil = Soil(grid, np.random.default_rng(1).random(grid.shape), params)
for tick in range(1, 30):
    sweeps = empty_rows(SWEEP, 20)
    sweeps["pair"] = (0, 0, 1, 1, 2, 2, 0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4)
    sweeps["tool"][6:], sweeps["action"][6:] = 1, SweepAction.COMPACT
    sweeps["pressure"][6:10] = 1e4
    sweeps["y0"] = sweeps["y1"] = (0.5, -0.5) * 10
    sweeps["z0"][:10] = (0.0, 0.0, 0.3, 0.3, 0.6, 0.6, 0.0, 0.0, 0.3, 0.3)
    sweeps["x0"], sweeps["x1"] = 0.05 * tick, 0.05 * (tick + 1)
    drum, angles = sweeps[10:], np.repeat(np.linspace(0.0, 2.0 * np.pi, 5), 2)
    drum["tool"], drum["action"] = 2, SweepAction.MILL if tick % 2 else SweepAction.CUT
    drum["x0"] += 0.4 * np.cos(angles)
    drum["x1"] += 0.4 * np.cos(angles + 0.1)
    drum["z0"], drum["z1"] = 0.4 * np.sin(angles), 0.4 * np.sin(angles + 0.1)
    sweeps["z1"][:10] = sweeps["z0"][:10]
    requests = empty_rows(DEPOSIT_REQUEST, 3)
    requests["volume_mm3"], requests["particle_id"] = 50_000_000, 3 * tick + np.arange(3)
    # Rows of a received message must not be written to.
    sweeps.flags.writeable = requests.flags.writeable = tick % 2 == 0
    step = soil.step(tick, sweeps, requests)
    SoilInventory().record_conversions(step.conversions, {0: 1})
    soil.state_hash()
assert step.map_updates.size
assert not [name for name in sys.modules if name.startswith("machine_sim")]
print(*(kernel.py_func.__name__ for kernel in compiled))
"""


@pytest.mark.parametrize("cut_mode", ["swept", "reference"])
def test_nothing_is_compiled_after_the_warm_up(cut_mode):
    code = PROBE.replace("CUT_MODE", repr(cut_mode))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "", "compiled after the warm-up"

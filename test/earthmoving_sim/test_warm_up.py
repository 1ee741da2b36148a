"""No tick of a machine that digs compiles a kernel after the warm-up."""

from __future__ import annotations

import subprocess
import sys

import pytest

# Prints the kernels that Numba compiles or loads while a machine digs, after the warm-up.
PROBE = """\
from dataclasses import replace
from numba.core import dispatcher
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig

config = load_run_config()
particles = replace(config.particles, mode=MODE)
stepping = replace(config.stepping, track_model=TRACKS)
dig = SingleProcessDig(replace(config, particles=particles, stepping=stepping))
late = []
compile_kernel = dispatcher.Dispatcher.compile
dispatcher.Dispatcher.compile = lambda self, sig: late.append(self) or compile_kernel(self, sig)

class Dug(Exception):
    pass

step = dig._step

def step_until_dug():
    step()
    if dig.machine.payload.fill > 0.2:
        raise Dug

dig._step = step_until_dug
try:
    dig.run()
except Dug:
    print(*(kernel.py_func.__name__ for kernel in late))
"""


@pytest.mark.parametrize(
    ("mode", "tracks"), [("spheres", "kinematic"), ("spheres", "dynamic"), ("cubes", "kinematic")]
)
def test_nothing_is_compiled_after_the_warm_up(mode: str, tracks: str) -> None:
    code = PROBE.replace("MODE", repr(mode)).replace("TRACKS", repr(tracks))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1:] == [""], "compiled after the warm-up"

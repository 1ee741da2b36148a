"""What holds for every kernel: the same bits, however and whenever it was compiled."""

import importlib
import pkgutil

import pytest
from numba.core.dispatcher import Dispatcher

import machine_sim
import soil_sim
from msg_bridge.kernels import ThreadedKernel


def kernels_of(package):
    """Dispatchers by the name of module and kernel."""
    found = {}
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if info.name.rsplit(".", 1)[-1] == "node":
            continue
        for name, value in vars(importlib.import_module(info.name)).items():
            several = isinstance(value, ThreadedKernel)
            for kernel in (value.for_threads(1), value.for_threads(2)) if several else (value,):
                if isinstance(kernel, Dispatcher):
                    found[f"{info.name}.{name}"] = kernel
    return found


@pytest.mark.parametrize("package", [soil_sim, machine_sim])
def test_no_kernel_is_compiled_with_fast_maths(package):
    kernels = kernels_of(package)
    assert len(kernels) > 30
    fast = [name for name, kernel in kernels.items() if kernel.targetoptions.get("fastmath")]
    assert fast == []

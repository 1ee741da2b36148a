"""Results of kernels do not depend on how and when they were compiled."""

import importlib
import pkgutil

import pytest
from numba.core.dispatcher import Dispatcher

import machine_sim
import soil_sim
from msg_bridge.kernels import ThreadedKernel


def kernels_of(package):
    """Return the dispatchers of a package by the names of module and kernel."""
    dispatchers = {}
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if "node" in info.name.split("."):
            continue
        for value in vars(importlib.import_module(info.name)).values():
            is_threaded = isinstance(value, ThreadedKernel)
            versions = (value.for_threads(1), value.for_threads(2)) if is_threaded else (value,)
            for version in versions:
                kernel = getattr(version, "dispatcher", version)
                if isinstance(kernel, Dispatcher):
                    dispatchers[f"{info.name}.{kernel.py_func.__name__}"] = kernel
    return dispatchers


@pytest.mark.parametrize("package", [soil_sim, machine_sim])
def test_no_kernel_is_compiled_with_fast_maths(package):
    kernels = kernels_of(package)
    assert len(kernels) > 30
    fast = [name for name, kernel in kernels.items() if kernel.targetoptions.get("fastmath")]
    assert fast == []

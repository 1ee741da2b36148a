"""Compile all kernels into the cache, so that nodes start in two seconds instead of minutes.

Kernels are machine code for this computer's CPU. They are compiled once after an installation, by
this command or else by the first start of a node, and again after a change of the code. They are
kept beside the installed modules, or in the user's cache folder where those are not writable.
"""

import argparse
import subprocess
import time

from msg_bridge.processes import python_module_command

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "compile all kernels, so that the first start takes no longer than the next ones"

_MODULE = "earthmoving_sim.kernel_groups"
_GROUPS = ("machine_sim", "soil_sim", "dig_operator")  # the one that takes longest first


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add no options."""


def run(args: argparse.Namespace) -> int:
    """Compile each group in a process of its own; return 1 if one of them failed, else 0."""
    start = time.monotonic()
    processes = [subprocess.Popen(python_module_command(_MODULE, [each])) for each in _GROUPS]
    try:
        codes = [each.wait() for each in processes]
    except BaseException:
        for each in processes:
            each.terminate()
        raise
    print(f"done in {time.monotonic() - start:.0f} s")
    return int(any(codes))

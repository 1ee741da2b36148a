"""Compile the kernels of one package in this process, for `earthmoving compile`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping

from msg_bridge.config_files import find_config, shipped_configs
from msg_bridge.kernels import log_compilation
from msg_bridge.kernels.compilation import kernel_state

__all__ = ["GROUPS", "compile_group"]


def _compile_soil() -> None:
    from soil_sim.soils.params import SoilParams
    from soil_sim.warm_up import warm_up

    for mode in ("swept", "reference"):
        warm_up(SoilParams(cut_mode=mode))


def _compile_machines() -> None:
    from machine_sim.dem import ParticleParams
    from machine_sim.machine import load_machine_spec
    from machine_sim.machine.tracks.track_model import TRACK_MODELS
    from machine_sim.params import MachineSimParams
    from machine_sim.warm_up import warm_up

    machines = [
        load_machine_spec(find_config(name))
        for name in shipped_configs()
        if name.startswith("machines/")
    ]
    for model in TRACK_MODELS:
        warm_up(machines, MachineSimParams(track_model=model))
    warm_up(machines, particles=ParticleParams(mode="cubes"))


def _compile_operator() -> None:
    from dig_operator.bucket_kinematics import BucketKinematics
    from machine_sim.machine import load_machine_spec

    BucketKinematics(load_machine_spec(find_config("machines/excavator.yaml"))).warm_up()


GROUPS: Mapping[str, Callable[[], None]] = {
    "soil_sim": _compile_soil,
    "machine_sim": _compile_machines,
    "dig_operator": _compile_operator,
}
"""Functions that compile the kernels of a package for all values of its parameters, except those
for several threads."""


def compile_group(name: str) -> None:
    """Compile the kernels of a package, and print the progress."""

    def print_line(text: str) -> None:
        print(f"{name}: {text}", flush=True)

    with log_compilation(print_line):
        GROUPS[name]()
    print_line(f"all kernels are in the cache, under {kernel_state.cache_folder}")


if __name__ == "__main__":
    compile_group(sys.argv[1])

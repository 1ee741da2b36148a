"""Check a machine file, and say what is wrong with it or what machine it makes.

Reads FILE as the nodes do. What is wrong is named with its place in the file and what to change. A
file that is right is summed up: links with masses, joints with what moves them, tools, and how the
machine stands with either model of tracks. Exits with 0 if both models can be made, else with 2.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from machine_sim.machine import MachineSpec

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "check a machine file: what is wrong with it, or what machine it makes"

_SETTLE_STEPS = 200
"""Steps of 5 ms that a machine is let stand."""
_MAX_TILT_DEG = 5.0
"""Tilt on level ground from which on a machine does not stand on its tracks [deg]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to do with which file."""
    parser.add_argument("what", choices=["check"], help="check: read the file and stand on it")
    parser.add_argument("file", type=Path, help="a machine file (YAML)")


def run(args: argparse.Namespace) -> int:
    """Check and print; bad files raise with the reason."""
    from machine_sim.machine import load_machine_spec
    from msg_bridge.config_files import find_config

    path = args.file if args.file.exists() else find_config(str(args.file))
    spec = load_machine_spec(path)
    print("\n".join(_summary_lines(spec)))
    return 0


def _summary_lines(machine: "MachineSpec") -> Iterator[str]:
    """What machine it is, to read."""
    yield f"{machine.name}: {machine.mass:,.0f} kg"
    for name, link in machine.links.items():
        yield f"  link    {name:<10}{link.mass:>10,.0f} kg, {len(link.boxes)} boxes"
    for name, joint in machine.joints.items():
        by = "cylinder" if name in machine.cylinders else "motor"
        span = "without end" if joint.lower == float("-inf") else ""
        span = span or f"{joint.lower:+.2f} to {joint.upper:+.2f} rad"
        yield (
            f"  joint   {name:<10}{joint.parent} to {joint.child} about {joint.axis}, {span},"
            f" {joint.max_velocity:g} rad/s, {by} of {joint.max_effort / 1e3:,.0f} kN m"
        )
    for name, mount in machine.tools.items():
        kind = type(mount.shape).__name__.removesuffix("Shape").lower()
        holds = getattr(mount.shape, "heaped_capacity", None)
        of = f" of {holds:.2f} m3 heaped" if holds else ""
        yield f"  tool    {name:<10}{kind} on {mount.link}{of}"
    if not machine.tools:
        yield "  tool    none: it drives, and touches no soil but by its tracks"
    yield from _standing_lines(machine)


def _standing_lines(machine: "MachineSpec") -> Iterator[str]:
    """How it stands on level ground with tracks of each model."""
    import numpy as np

    from machine_sim.machine.tracks.track_model import TRACK_MODELS
    from machine_sim.params import MachineSimParams
    from machine_sim.simulated_machine import Placement
    from machine_sim.simulation import MachineSim
    from msg_bridge.contract.grid import Grid

    grid = Grid(129, 129, 0.2)
    for model in TRACK_MODELS:
        params = MachineSimParams(track_model=model, steps_per_tick=1)
        sim = MachineSim([Placement(machine)], grid, np.zeros(grid.shape), params=params)
        for _ in range(_SETTLE_STEPS):
            sim.step()
        tilt = np.degrees(sim.machine.tilt)
        tips = (
            "; it tips up: move masses toward the middle of its tracks"
            if tilt > _MAX_TILT_DEG
            else ""
        )
        yield f"  tracks  {model:<10}stands tilted by {tilt:.1f} deg{tips}"
        sim.close()

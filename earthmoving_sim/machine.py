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
    from machine_sim.machine import MachineDescription

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "check a machine file: what is wrong with it, or what machine it makes"

_SETTLES = 200
"""Steps of 5 ms that a machine is let stand."""
_LEANS = 5.0
"""Tilt on level ground from which on a machine does not stand on its tracks [deg]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to do with which file."""
    parser.add_argument("what", choices=["check"], help="check: read the file and stand on it")
    parser.add_argument("file", type=Path, help="a machine file (YAML)")


def run(args: argparse.Namespace) -> int:
    """Check and print; bad files raise with the reason."""
    from machine_sim.machine import load_description
    from msg_bridge.config_files import find_config

    path = args.file if args.file.exists() else find_config(str(args.file))
    description = load_description(path)
    print("\n".join(_lines(description)))
    return 0


def _lines(machine: "MachineDescription") -> Iterator[str]:
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
            f" {joint.speed:g} rad/s, {by} of {joint.torque / 1e3:,.0f} kN m"
        )
    for name, mount in machine.tools.items():
        kind = type(mount.shape).__name__.removesuffix("Shape").lower()
        holds = getattr(mount.shape, "heaped_capacity", None)
        of = f" of {holds:.2f} m3 heaped" if holds else ""
        yield f"  tool    {name:<10}{kind} on {mount.link}{of}"
    if not machine.tools:
        yield "  tool    none: it drives, and touches no soil but by its tracks"
    yield from _standing(machine)


def _standing(machine: "MachineDescription") -> Iterator[str]:
    """How it stands on level ground with tracks of each model."""
    import numpy as np

    from machine_sim.core import MachineSim
    from machine_sim.machine.tracks.model import TRACK_MODELS
    from machine_sim.params import MachineSimParams
    from machine_sim.work.rig import Placement
    from msg_bridge.contract.grid import Grid

    grid = Grid(129, 129, 0.2)
    for model in TRACK_MODELS:
        params = MachineSimParams(tracks=model, steps_per_tick=1)
        sim = MachineSim([Placement(machine)], grid, np.zeros(grid.shape), params=params)
        for _ in range(_SETTLES):
            sim.step()
        tilt = np.degrees(sim.machine.tilt)
        tips = "; it tips up: move masses toward the middle of its tracks" if tilt > _LEANS else ""
        yield f"  tracks  {model:<10}stands tilted by {tilt:.1f} deg{tips}"
        sim.close()

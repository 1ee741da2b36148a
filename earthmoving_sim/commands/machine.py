"""Check a machine file and print the machine that it describes.

Reads FILE as the nodes do. An error names its place in the file and what to change. A valid file is
summarised: links with masses, joints with their actuators, tools, and the tilt of the machine at
rest with both track models. Exits with 0 if the file is valid, else with 2.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from machine_sim.machine import MachineSpec

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "check a machine file and print the machine that it describes"

_SETTLE_STEPS = 200
"""Number of 5 ms steps until the machine is at rest."""

_MAX_TILT_DEG = 5.0
"""Maximum tilt on level ground of a machine that stands on its tracks [deg]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the action and the file."""
    parser.add_argument("action", choices=["check"], help="check: read the file, let it stand")
    parser.add_argument("file", type=Path, help="a machine file (YAML)")


def run(args: argparse.Namespace) -> int:
    """Check the file and print the machine; return 0.

    Raises:
        ConfigError, MachineError: the file is missing or not valid.
    """
    from machine_sim.machine import load_machine_spec
    from msg_bridge.config_files import find_config

    path = args.file if args.file.exists() else find_config(str(args.file))
    spec = load_machine_spec(path)
    print("\n".join(_summary_lines(spec)))
    return 0


def _summary_lines(machine: "MachineSpec") -> Iterator[str]:
    """Yield the lines of the summary."""
    yield f"{machine.name}: {machine.mass:,.0f} kg"
    for name, link in machine.links.items():
        yield f"  link    {name:<10}{link.mass:>10,.0f} kg, {len(link.boxes)} boxes"
    for name, joint in machine.joints.items():
        actuator = "cylinder" if name in machine.cylinders else "motor"
        is_continuous = joint.lower == float("-inf")
        limits = "continuous" if is_continuous else f"{joint.lower:+.2f} to {joint.upper:+.2f} rad"
        yield (
            f"  joint   {name:<10}{joint.parent} to {joint.child} about {joint.axis}, {limits},"
            f" {joint.max_velocity:g} rad/s, {actuator} of {joint.max_effort / 1e3:,.0f} kN m"
        )
    for name, mount in machine.tools.items():
        kind = type(mount.shape).__name__.removesuffix("Shape").lower()
        capacity = getattr(mount.shape, "heaped_capacity", None)
        size = f" of {capacity:.2f} m3 heaped" if capacity else ""
        yield f"  tool    {name:<10}{kind} on {mount.link}{size}"
    if not machine.tools:
        yield "  tool    none"
    yield from _standing_lines(machine)


def _standing_lines(machine: "MachineSpec") -> Iterator[str]:
    """Yield the tilt of the machine on level ground with each track model."""
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

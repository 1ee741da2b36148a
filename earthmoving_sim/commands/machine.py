"""Check a machine file and print the machine that it describes.

Reads FILE as the nodes do. An error names its place in the file and what to change. A valid file is
summarised: links with masses, joints with their actuators, tools, visual shapes, and the tilt of
the machine at rest with both track models. If the file has `references`, published figures of real
machines, the machine's own are measured in the simulation and printed beside them. --picture and
--mesh show what it looks like. Exits with 0 if the file is valid, else with 2.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from earthmoving_sim.option_checks import check_output_file

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from machine_sim.machine import MachineSpec

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "check a machine file and print the machine that it describes"

_PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")

_SETTLE_STEPS = 200
"""Number of 5 ms steps until the machine is at rest."""

_MAX_TILT_DEG = 5.0
"""Maximum tilt on level ground of a machine that stands on its tracks [deg]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the action and the file."""
    parser.add_argument("action", choices=["check"], help="check: read the file, let it stand")
    parser.add_argument("file", type=Path, help="a machine file (YAML)")
    parser.add_argument(
        "--picture", type=Path, metavar="PNG", help="draw the machine from the side and the front"
    )
    parser.add_argument(
        "--mesh",
        type=Path,
        metavar="GLB",
        help="write the machine as a binary glTF for 3-D programs",
    )


def run(args: argparse.Namespace) -> int:
    """Check the file, print the machine and write picture and mesh; return 0.

    Raises:
        ConfigError, MachineError: the file is missing or not valid.
        EarthmovingError: picture or mesh cannot be written.
    """
    from machine_sim.machine import load_machine_spec
    from msg_bridge.config_files import find_config

    # Before the figures are measured, which takes up to a minute.
    if args.picture:
        check_output_file("--picture", args.picture, _PICTURE_SUFFIXES)
    if args.mesh:
        check_output_file("--mesh", args.mesh, (".glb",))
    path = args.file if args.file.exists() else find_config(str(args.file))
    spec = load_machine_spec(path)
    print("\n".join(_summary_lines(spec)))
    if args.picture:
        _draw(spec, args.picture)
    if args.mesh:
        _write_mesh(spec, args.mesh)
    return 0


def _summary_lines(machine: "MachineSpec") -> Iterator[str]:
    """Yield the lines of the summary."""
    yield f"{machine.name}: {machine.mass:,.0f} kg"
    for name, link in machine.links.items():
        shapes = len(machine.shapes.links.get(name, ()))
        parts = f"{len(link.boxes)} boxes, {shapes} shapes"
        yield f"  link    {name:<10}{link.mass:>10,.0f} kg, {parts}"
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
    yield from _shape_lines(machine)
    yield from _standing_lines(machine)
    yield from _comparison_lines(machine)


def _shape_lines(machine: "MachineSpec") -> Iterator[str]:
    """Yield the size of the meshes and the points of view."""
    from machine_sim.machine.description import description_text
    from machine_sim.machine.shapes.link_meshes import link_meshes, num_triangles

    triangles, size = num_triangles(link_meshes(machine).values()), len(description_text(machine))
    yield f"  shapes  {triangles:,} triangles, robot_description of {size / 1e3:,.0f} kB"
    for view in machine.shapes.view_points:
        yield f"  view    {view.name} on {view.link}"


def _comparison_lines(machine: "MachineSpec") -> Iterator[str]:
    """Yield the figures of the machine beside those of the reference machines."""
    if not machine.references:
        return
    from earthmoving_sim.machine_performance import machine_figures
    from machine_sim.machine.reference_machine import FIGURE_UNITS

    names = [reference.name for reference in machine.references]
    yield f"  {'figure':<24}{'unit':<7}{machine.name:>10}" + "".join(f"{n:>22}" for n in names)
    published_figures = {figure for reference in machine.references for figure in reference.figures}
    for figure, value in machine_figures(machine).items():
        if figure not in published_figures:
            continue
        cells = ""
        for reference in machine.references:
            published = reference.figures.get(figure)
            cell = f"{published:,g} ({value / published - 1.0:+.0%})" if published else "-"
            cells += f"{cell:>22}"
        label = figure.replace("_", " ")
        yield f"  {label:<24}{FIGURE_UNITS[figure]:<7}{_rounded(value):>10}{cells}"
    for reference in machine.references:
        yield f"  {reference.name}: {reference.source}"


def _rounded(value: float) -> str:
    """Return a value with three or more significant digits."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def _shoe_poses(machine: "MachineSpec") -> "NDArray[np.float64]":
    """Return the poses of the shoes of a machine on level ground, shape (2, n, 3)."""
    import numpy as np

    from machine_sim.params import MachineSimParams
    from machine_sim.simulated_machine import Placement
    from machine_sim.simulation import MachineSim
    from msg_bridge.contract.grid import Grid

    grid = Grid(129, 129, 0.2)
    params = MachineSimParams(steps_per_tick=1)
    sim = MachineSim([Placement(machine)], grid, np.zeros(grid.shape), params=params)
    sim.step()
    poses = sim.machine.tracks.shoe_poses.copy()
    sim.close()
    return poses


def _draw(machine: "MachineSpec", path: Path) -> None:
    """Write a picture of the machine."""
    import numpy as np

    from earthmoving_sim.machine_mesh import machine_mesh
    from earthmoving_sim.pictures.machine_view import draw_machine

    pose = (np.zeros(3), np.eye(3), machine.home)
    print(f"  {draw_machine(machine_mesh(machine, *pose, _shoe_poses(machine)), path)}")


def _write_mesh(machine: "MachineSpec", path: Path) -> None:
    """Write the machine as binary glTF."""
    from machine_sim.machine.shapes.glb import glb_bytes
    from machine_sim.machine.shapes.posed_mesh import posed_mesh

    path.write_bytes(glb_bytes(posed_mesh(machine, _shoe_poses(machine))))
    print(f"  {path}")


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

"""Drop spheres on level ground in LIGGGHTS: write its input, run it, and read its output.

LIGGGHTS is a free discrete element program (https://www.cfdem.com). The contact model is the one
most used in it: Hertz's law with damping, a tangential spring with Coulomb friction, and rolling
resistance as an elastic-plastic spring-dashpot (`epsd2`), with which a heap comes to rest. With
the simpler `cdt` the heap does not come to rest, and the cost is no lower.

The settings are the cheapest that give correct results. The spheres are as soft as LIGGGHTS
accepts, because softer spheres allow a longer time step; the time step is at most a fifth of the
Rayleigh time, as is common. The skin of the neighbour lists and the box that follows the particles
were the fastest in trials.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PROGRAM = "liggghts"
INSTALL_HINT = (
    "LIGGGHTS is not installed: no program `liggghts` is on the PATH. Debian and Ubuntu have it:"
    " apt-get install liggghts"
)
MIN_YOUNGS_MODULUS = 5e6
"""Lowest Young's modulus that LIGGGHTS accepts by default [Pa]."""

_POISSON_RATIO = 0.3
_MAX_RAYLEIGH_FRACTION = 0.2
_TIME_LIMIT = 3600.0  # [s]
_LOOP = re.compile(r"^Loop time of (\S+) on \d+ procs for (\d+) steps with (\d+) atoms", re.M)
_DANGEROUS = re.compile(r"^Dangerous builds = (\d+)", re.M)


class LiggghtsError(Exception):
    """LIGGGHTS cannot be run, or its result cannot be used."""


@dataclass(frozen=True)
class ContactCoefficients:
    """Coefficients of a contact between two spheres, or between a sphere and the ground.

    Attributes:
        friction: Coulomb friction coefficient.
        rolling_friction: rolling friction coefficient.
        restitution: coefficient of restitution.
    """

    friction: float
    rolling_friction: float
    restitution: float


@dataclass(frozen=True)
class Spheres:
    """Spheres at rest above level ground.

    Attributes:
        position: centres [m], shape (n, 3); the ground is at z = 0.
        radius: radii [m], shape (n,).
        density: densities [kg/m^3], shape (n,).
        gravity: gravitational acceleration [m/s^2].
        particle_contact: coefficients between two spheres.
        ground_contact: coefficients between a sphere and the ground.
    """

    position: NDArray[np.float64]
    radius: NDArray[np.floating]
    density: NDArray[np.floating]
    gravity: float
    particle_contact: ContactCoefficients
    ground_contact: ContactCoefficients


@dataclass(frozen=True)
class HeapResult:
    """Result of a run.

    Attributes:
        seconds: wall time of each part of the run [s], without reading and set-up.
        position: centres at the end [m], shape (n, 3).
    """

    seconds: list[float]
    position: NDArray[np.float64]


def is_installed() -> bool:
    """Return whether the program is on the PATH."""
    return shutil.which(PROGRAM) is not None


def rayleigh_time(radius: float, density: float, youngs_modulus: float) -> float:
    """Return the time [s] of a Rayleigh wave over half a sphere's circumference; limits the step.

    Args:
        radius: [m].
        density: [kg/m^3].
        youngs_modulus: [Pa].
    """
    rigidity = youngs_modulus / (2.0 * (1.0 + _POISSON_RATIO))
    wave_number = 0.1631 * _POISSON_RATIO + 0.8766
    return math.pi * radius * math.sqrt(density / rigidity) / wave_number


def substeps(spheres: Spheres, interval: float, youngs_modulus: float) -> int:
    """Return the smallest number of steps in an interval [s], each <= 0.2 of the Rayleigh time."""
    shortest = min(
        rayleigh_time(r, d, youngs_modulus)
        for r, d in np.unique(np.column_stack([spheres.radius, spheres.density]), axis=0).tolist()
    )
    return math.ceil(interval / (_MAX_RAYLEIGH_FRACTION * shortest))


def data_text(spheres: Spheres) -> str:
    """Return the particle file with diameters and densities for the command `read_data`."""
    width = np.ptp(spheres.position, axis=0).max() + 1.0
    low, high = spheres.position.min(axis=0) - width, spheres.position.max(axis=0) + width
    bounds = [f"{a:.9g} {b:.9g} {x}lo {x}hi" for a, b, x in zip(low, high, "xyz", strict=True)]
    columns = zip(
        spheres.radius.tolist(), spheres.density.tolist(), spheres.position.tolist(), strict=True
    )
    rows = [
        f"{k} 1 {2.0 * r:.9g} {d:.9g} {x:.9g} {y:.9g} {z:.9g}"
        for k, (r, d, (x, y, z)) in enumerate(columns, start=1)
    ]
    head = ["falling spheres", "", f"{len(rows)} atoms", "2 atom types", *bounds]
    return "\n".join([*head, "", "Atoms", "", *rows, ""])


def input_text(
    spheres: Spheres,
    timestep: float,
    parts: Sequence[int],
    youngs_modulus: float = MIN_YOUNGS_MODULUS,
) -> str:
    """Return the script of a run, which reads `data.txt` and writes `end.txt` at the end.

    Args:
        spheres: the spheres at the start.
        timestep: [s].
        parts: number of time steps of each part that is timed.
        youngs_modulus: Young's modulus [Pa].
    """
    model = "model hertz tangential history rolling_friction epsd2"
    skin = float(spheres.radius.mean())
    modulus, poisson = f"{youngs_modulus:.9g}", _POISSON_RATIO

    def pairs(name: str) -> str:
        # Type 1 is the spheres, type 2 the ground.
        a, b = getattr(spheres.particle_contact, name), getattr(spheres.ground_contact, name)
        return f"peratomtypepair 2 {a:.9g} {b:.9g} {b:.9g} {b:.9g}"

    return "\n".join(
        [
            "atom_style granular",
            "atom_modify map array sort 100 0.0",
            "boundary s s s",
            "newton off",
            "communicate single vel yes",
            "units si",
            "read_data data.txt",
            f"neighbor {skin:.9g} bin",
            "neigh_modify delay 0",
            f"fix young all property/global youngsModulus peratomtype {modulus} {modulus}",
            f"fix poisson all property/global poissonsRatio peratomtype {poisson} {poisson}",
            f"fix rebound all property/global coefficientRestitution {pairs('restitution')}",
            f"fix coulomb all property/global coefficientFriction {pairs('friction')}",
            "fix rolling all property/global coefficientRollingFriction"
            f" {pairs('rolling_friction')}",
            f"pair_style gran {model}",
            "pair_coeff * *",
            f"timestep {timestep:.9g}",
            "fix motion all nve/sphere",
            f"fix weight all gravity {spheres.gravity:.9g} vector 0.0 0.0 -1.0",
            f"fix ground all wall/gran {model} primitive type 2 zplane 0.0",
            "thermo_style custom step atoms ke",
            "thermo 1000000",
            *(f"run {steps}" for steps in parts),
            "dump end all custom 1 end.txt id x y z",
            "run 0",
            "",
        ]
    )


def loop_seconds(output: str, parts: Sequence[int], count: int) -> list[float]:
    """Return the wall times [s] of the parts of a run from the output of LIGGGHTS.

    Raises:
        LiggghtsError: parts are missing, spheres were lost, or neighbour lists were built too late.
    """
    loops = [(float(t), int(steps), int(atoms)) for t, steps, atoms in _LOOP.findall(output)]
    loops = loops[: len(parts)]
    if [steps for _, steps, _ in loops] != list(parts):
        raise LiggghtsError(
            f"LIGGGHTS did not run {list(parts)} steps; its output ends with:\n{output[-2000:]}"
        )
    if any(atoms != count for _, _, atoms in loops):
        raise LiggghtsError(f"LIGGGHTS lost some of {count} spheres: {loops}")
    if any(int(num_late) for num_late in _DANGEROUS.findall(output)):
        raise LiggghtsError("LIGGGHTS built its neighbour lists too late; enlarge the skin")
    return [seconds for seconds, _, _ in loops]


def last_positions(dump: str, count: int) -> NDArray[np.float64]:
    """Return the centres [m] of a dump's last frame in the order of the data file.

    Returns:
        Centres of shape (count, 3).

    Raises:
        LiggghtsError: the frame is incomplete.
    """
    _, head, body = dump.rpartition("ITEM: ATOMS id x y z")
    rows = [line.split() for line in body.splitlines() if line.strip()]
    if not head or len(rows) != count or any(len(row) != 4 for row in rows):
        raise LiggghtsError(f"LIGGGHTS wrote {len(rows)} of {count} spheres at the end")
    table = np.array(rows, dtype=np.float64)
    return np.asarray(table[np.argsort(table[:, 0]), 1:])


def drop_spheres(
    spheres: Spheres,
    timestep: float,
    parts: Sequence[int],
    youngs_modulus: float = MIN_YOUNGS_MODULUS,
) -> HeapResult:
    """Run LIGGGHTS on one core; the arguments are those of `input_text`.

    Raises:
        LiggghtsError: LIGGGHTS is not installed or failed, or its result cannot be used.
    """
    count = len(spheres.position)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "data.txt").write_text(data_text(spheres))
        (folder / "in.txt").write_text(input_text(spheres, timestep, parts, youngs_modulus))
        output = run_program(folder, _TIME_LIMIT)
        seconds = loop_seconds(output, parts, count)
        return HeapResult(seconds, last_positions((folder / "end.txt").read_text(), count))


def run_program(folder: Path, time_limit: float) -> str:
    """Run `in.txt` of a folder on one core, and return the output of LIGGGHTS.

    Args:
        folder: its working folder.
        time_limit: wall time [s].

    Raises:
        LiggghtsError: LIGGGHTS is not installed, failed, or took longer.
    """
    if not is_installed():
        raise LiggghtsError(INSTALL_HINT)
    try:
        result = subprocess.run(
            [PROGRAM, "-in", "in.txt", "-log", "none"],
            cwd=folder,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=time_limit,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise LiggghtsError(f"LIGGGHTS took more than {time_limit:.0f} s") from error
    if result.returncode or "ERROR" in result.stdout:
        raise LiggghtsError(f"LIGGGHTS failed; its output ends with:\n{result.stdout[-2000:]}")
    return result.stdout

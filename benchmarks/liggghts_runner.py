"""Spheres that fall on level ground in LIGGGHTS: its input, a run of it, and what it said.

LIGGGHTS is a free program for discrete elements (https://www.cfdem.com). Contacts there are those
most used in it: Hertz's law with damping, a tangential spring with Coulomb friction, and rolling
resistance as a spring that yields (`epsd2`), with which a heap comes to rest; with the simpler
`cdt` it trembles on, and costs no less.

It is run as cheaply as is sound. Its spheres are as soft as it accepts, for the softer they are,
the longer may its time step be; that is a fifth of the Rayleigh time or less, as is common. The
skin of its neighbour lists and its box, which follows the particles, are those with which it was
fastest.
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
MISSING = (
    "LIGGGHTS is not installed: no program `liggghts` is on the PATH. Debian and Ubuntu have it:"
    " apt-get install liggghts"
)
MIN_YOUNGS_MODULUS = 5e6
"""The lowest Young's modulus that LIGGGHTS takes without being told to [Pa]."""

_POISSON = 0.3
_RAYLEIGH_SHARE = 0.2
_TIME_LIMIT = 3600.0  # [s]
_LOOP = re.compile(r"^Loop time of (\S+) on \d+ procs for (\d+) steps with (\d+) atoms", re.M)
_DANGEROUS = re.compile(r"^Dangerous builds = (\d+)", re.M)


class LiggghtsError(Exception):
    """LIGGGHTS cannot be run, or what it did is of no use."""


@dataclass(frozen=True)
class ContactCoefficients:
    """How two spheres touch, or one the ground: Coulomb and rolling friction, rebound."""

    friction: float
    rolling: float
    restitution: float


@dataclass(frozen=True)
class Spheres:
    """What is to fall.

    Attributes:
        position: centres [m], shape (n, 3); the ground is at z = 0.
        radius: [m], shape (n,).
        density: [kg/m^3], shape (n,).
        gravity: [m/s^2].
        each_other, ground: how they touch.
    """

    position: NDArray[np.float64]
    radius: NDArray[np.floating]
    density: NDArray[np.floating]
    gravity: float
    particle_contact: ContactCoefficients
    ground: ContactCoefficients


@dataclass(frozen=True)
class HeapResult:
    """What a run gave.

    Attributes:
        seconds: wall time of each part of the run [s], reading and setting up left out.
        position: centres at the end [m], shape (n, 3).
    """

    seconds: list[float]
    position: NDArray[np.float64]


def installed() -> bool:
    """Whether there is a LIGGGHTS to run."""
    return shutil.which(PROGRAM) is not None


def rayleigh_time(radius: float, density: float, young: float) -> float:
    """Time a wave takes along the surface of a sphere [s]; bounds the time step."""
    shear = young / (2.0 * (1.0 + _POISSON))
    return math.pi * radius * math.sqrt(density / shear) / (0.1631 * _POISSON + 0.8766)


def substeps(spheres: Spheres, interval: float, young: float) -> int:
    """Fewest time steps in an interval [s] that are each a fifth of the Rayleigh time or less."""
    least = min(
        rayleigh_time(r, d, young)
        for r, d in np.unique(np.column_stack([spheres.radius, spheres.density]), axis=0).tolist()
    )
    return math.ceil(interval / (_RAYLEIGH_SHARE * least))


def data_text(spheres: Spheres) -> str:
    """The file of particles, with diameter and density, as `read_data` wants it."""
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
    head = ["spheres that fall", "", f"{len(rows)} atoms", "2 atom types", *bounds]
    return "\n".join([*head, "", "Atoms", "", *rows, ""])


def input_text(
    spheres: Spheres, timestep: float, parts: Sequence[int], young: float = MIN_YOUNGS_MODULUS
) -> str:
    """The script of a run; it reads `data.txt` and ends with writing `end.txt`.

    Args:
        spheres: what falls.
        timestep: [s].
        parts: time steps of each part that is timed.
        young: Young's modulus [Pa].
    """
    model = "model hertz tangential history rolling_friction epsd2"
    particle_contact, ground = spheres.particle_contact, spheres.ground
    skin = float(spheres.radius.mean())

    def pairs(name: str) -> str:
        # Type 1 are the spheres, type 2 is the ground.
        a, b = getattr(particle_contact, name), getattr(ground, name)
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
            f"fix young all property/global youngsModulus peratomtype {young:.9g} {young:.9g}",
            f"fix poisson all property/global poissonsRatio peratomtype {_POISSON} {_POISSON}",
            f"fix rebound all property/global coefficientRestitution {pairs('restitution')}",
            f"fix coulomb all property/global coefficientFriction {pairs('friction')}",
            f"fix rolling all property/global coefficientRollingFriction {pairs('rolling')}",
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


def loop_seconds(said: str, parts: Sequence[int], count: int) -> list[float]:
    """Wall times [s] of the parts of a run, from what LIGGGHTS printed.

    Raises:
        LiggghtsError: parts are missing, spheres were lost, or neighbours seen too late.
    """
    loops = [(float(t), int(steps), int(atoms)) for t, steps, atoms in _LOOP.findall(said)]
    loops = loops[: len(parts)]
    if [steps for _, steps, _ in loops] != list(parts):
        raise LiggghtsError(f"LIGGGHTS did not run {list(parts)} steps; it said:\n{said[-2000:]}")
    if any(atoms != count for _, _, atoms in loops):
        raise LiggghtsError(f"LIGGGHTS lost some of {count} spheres: {loops}")
    if any(int(late) for late in _DANGEROUS.findall(said)):
        raise LiggghtsError("LIGGGHTS built its neighbour lists too late; give it a larger skin")
    return [seconds for seconds, _, _ in loops]


def last_positions(dump: str, count: int) -> NDArray[np.float64]:
    """Centres [m] in the order of the data file, shape (count, 3), from a dump's last frame.

    Raises:
        LiggghtsError: they are not all there.
    """
    _, head, body = dump.rpartition("ITEM: ATOMS id x y z")
    rows = [line.split() for line in body.splitlines() if line.strip()]
    if not head or len(rows) != count or any(len(row) != 4 for row in rows):
        raise LiggghtsError(f"LIGGGHTS wrote {len(rows)} of {count} spheres at the end")
    table = np.array(rows, dtype=np.float64)
    return np.asarray(table[np.argsort(table[:, 0]), 1:])


def fall(
    spheres: Spheres, timestep: float, parts: Sequence[int], young: float = MIN_YOUNGS_MODULUS
) -> HeapResult:
    """Run LIGGGHTS on one core; arguments as of `input_text`.

    Raises:
        LiggghtsError: it is not installed, it failed, or what it did is of no use.
    """
    if not installed():
        raise LiggghtsError(MISSING)
    count = len(spheres.position)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "data.txt").write_text(data_text(spheres))
        (folder / "in.txt").write_text(input_text(spheres, timestep, parts, young))
        try:
            result = subprocess.run(
                [PROGRAM, "-in", "in.txt", "-log", "none"],
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=_TIME_LIMIT,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise LiggghtsError(f"LIGGGHTS took more than {_TIME_LIMIT:.0f} s") from error
        if result.returncode or "ERROR" in result.stdout:
            raise LiggghtsError(f"LIGGGHTS failed; it said:\n{result.stdout[-2000:]}")
        seconds = loop_seconds(result.stdout, parts, count)
        return HeapResult(seconds, last_positions((folder / "end.txt").read_text(), count))

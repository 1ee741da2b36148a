"""Payload: the soil in a tool, measured from the particles that are in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.shapes import ContainerShape
from msg_bridge.kernels import kernel

__all__ = ["EMPTY_PAYLOAD", "Payload", "loose_volume", "measure_payload"]


@dataclass(frozen=True)
class Payload:
    """Soil in a tool.

    Attributes:
        bank_m3: bank volume [m^3].
        loose_m3: loose volume [m^3].
        mass_kg: mass [kg].
        fill: loose volume as a fraction of the tool's heaped capacity.
    """

    bank_m3: float
    loose_m3: float
    mass_kg: float
    fill: float


EMPTY_PAYLOAD = Payload(0.0, 0.0, 0.0, 0.0)
"""Payload of an empty tool, and of one that cannot carry soil."""


def measure_payload(shape: ContainerShape, particles: SoilEngine, pose: Pose) -> Payload:
    """Sum up the particles inside a container, or heaped on it, at a pose.

    Args:
        shape: shape of the bucket or bed.
        particles: the particle engine.
        pose: rotation container to map, shape (3, 3), and origin [m], shape (3,).
    """
    if particles.count == 0:
        return EMPTY_PAYLOAD
    inside = shape.indices_in_heap(particles.positions, *pose)
    if inside.size == 0:
        return EMPTY_PAYLOAD
    bank_mm3, loose_mm3, mass_kg = _sum_rows(particles, inside)
    loose_m3 = 1e-9 * loose_mm3
    return Payload(1e-9 * bank_mm3, loose_m3, mass_kg, loose_m3 / shape.heaped_capacity)


def loose_volume(particles: SoilEngine, rows: NDArray[np.intp]) -> float:
    """Return the loose volume of some rows of particles [m^3]."""
    _, loose_mm3, _ = _sum_rows(particles, rows)
    return 1e-9 * loose_mm3


def _sum_rows(particles: SoilEngine, rows: NDArray[np.intp]) -> tuple[int, float, float]:
    """Return bank volume [mm^3], loose volume [mm^3] and mass [kg] of some rows of particles."""
    sums: tuple[int, float, float] = _sum(
        rows, particles.volumes_mm3, particles.soil, particles.masses, particles.swells
    )
    return sums


@kernel
def _sum(rows, volume_mm3, soil, mass, swells):  # type: ignore[no-untyped-def]
    """Return the sums of `_sum_rows` from columns of all particles, and the swell of each soil."""
    bank, loose, kilograms = 0, 0.0, 0.0
    for i in rows:
        bank += volume_mm3[i]
        loose += volume_mm3[i] * (1.0 + swells[soil[i]])
        kilograms += mass[i]
    return bank, loose, kilograms

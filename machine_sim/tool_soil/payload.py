"""Payload: the soil in a tool, measured from the particles that are in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.shapes import ContainerShape

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
    inside = shape.indices_in_heap(particles.positions, *pose)
    if inside.size == 0:
        return EMPTY_PAYLOAD
    loose_m3 = loose_volume(particles, inside)
    return Payload(
        int(particles.volumes_mm3[inside].sum()) * 1e-9,
        loose_m3,
        float(particles.masses[inside].sum()),
        loose_m3 / shape.heaped_capacity,
    )


def loose_volume(particles: SoilEngine, rows: NDArray[np.intp]) -> float:
    """Return the loose volume of some rows of particles [m^3]."""
    swell = np.array([soil.swell for soil in particles.soils])
    bank = particles.volumes_mm3[rows]
    return float((bank * (1.0 + swell[particles.soil[rows]])).sum()) * 1e-9

"""Payload: the soil in a tool, measured from the particles that are in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.open_container import (
    is_in_heap,
    is_in_struck_volume,
    local_point,
)
from machine_sim.machine.tools.shapes import ContainerShape
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = [
    "EMPTY_PAYLOAD",
    "Payload",
    "loose_volume",
    "measure_payload",
    "payload_of",
    "sum_inside",
]


class Payload(NamedTuple):
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
    bank_mm3, loose_mm3, mass_kg = _sum_inside(
        shape.boxed, *pose, particles.boxed_columns, particles.swells
    )
    return payload_of(bank_mm3, loose_mm3, mass_kg, shape.heaped_capacity)


def payload_of(bank_mm3: int, loose_mm3: float, mass_kg: float, heaped_capacity: float) -> Payload:
    """Return the payload of volumes [mm^3] and a mass [kg] in a container of a capacity [m^3]."""
    if bank_mm3 == 0:
        return EMPTY_PAYLOAD
    loose_m3 = 1e-9 * loose_mm3
    return Payload(1e-9 * bank_mm3, loose_m3, mass_kg, loose_m3 / heaped_capacity)


def loose_volume(particles: SoilEngine, rows: NDArray[np.intp]) -> float:
    """Return the loose volume of some rows of particles [m^3]."""
    loose_mm3: float = _sum_loose(rows, particles.volumes_mm3, particles.soil, particles.swells)
    return 1e-9 * loose_mm3


@fixed_signature_kernel
def _sum_inside(boxed_container, rotation, origin, boxed_particles, swells):  # type: ignore[no-untyped-def]
    """Return bank volume, loose volume and mass of `sum_inside`, with boxed tables."""
    bank, loose, mass, _ = sum_inside(
        boxed_container.table, rotation, origin, boxed_particles.table, swells
    )
    return bank, loose, mass


@helper
def sum_inside(container, rotation, origin, particles, swells):  # type: ignore[no-untyped-def]
    """Sum up the particles in the struck volume of a container or in its heap.

    Args:
        container: `ContainerTable`.
        rotation, origin: its pose.
        particles: `ParticleColumns`.
        swells: swell of each soil.

    Returns:
        Bank volume [mm^3], loose volume [mm^3] and mass [kg], and the loose volume below the
        opening [m^3].
    """
    position, volume_mm3, mass = particles.position, particles.volume_mm3, particles.mass
    bank, loose, kilograms, struck = 0, 0.0, 0.0, 0.0
    for i in range(len(position)):
        is_near, x, z = local_point(position, i, container, rotation, origin)
        if not is_near:
            continue
        is_struck = is_in_struck_volume(x, z, container)
        if is_struck or is_in_heap(x, z, container):
            bulking = 1.0 + swells[particles.soil[i]]
            bank += volume_mm3[i]
            loose += volume_mm3[i] * bulking
            kilograms += mass[i]
            if is_struck:
                struck += 1e-9 * volume_mm3[i] * bulking
    return bank, loose, kilograms, struck


@kernel
def _sum_loose(rows, volume_mm3, soil, swells):  # type: ignore[no-untyped-def]
    """Return the loose volume of `loose_volume` [mm^3] from columns of all particles."""
    loose = 0.0
    for i in rows:
        loose += volume_mm3[i] * (1.0 + swells[soil[i]])
    return loose

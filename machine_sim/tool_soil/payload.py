"""Payload: the soil that is in the tool, counted from the particles really in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.shapes import ContainerShape

__all__ = ["Payload", "measure_payload"]


@dataclass(frozen=True)
class Payload:
    """Soil in a tool.

    Attributes:
        bank: bank volume [m^3].
        loose: volume as it lies in the tool [m^3].
        mass: [kg].
        fill: loose volume in parts of the tool's heaped capacity.
    """

    bank: float
    loose: float
    mass: float
    fill: float


def measure_payload(shape: ContainerShape, particles: SoilEngine, pose: Pose) -> Payload:
    """Count the particles inside a bucket or bed that stands at a pose, and in the heap on it."""
    state = particles.state
    inside = shape.indices_in_heap(state.position, *pose)
    if inside.size == 0:
        return Payload(0.0, 0.0, 0.0, 0.0)
    volume = state.volume_mm3[inside]
    swell = np.array([soil.swell for soil in particles.soils])
    loose = float((volume * (1.0 + swell[state.soil[inside]])).sum()) * 1e-9
    return Payload(
        int(volume.sum()) * 1e-9,
        loose,
        float(state.mass[inside].sum()),
        loose / shape.heaped_capacity,
    )

"""Columns of the particle state that the kernels of a step read and write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["StepParticles"]


class StepParticles(NamedTuple):
    """Columns of `ParticleState`; see there for the units.

    One table for all stages: passing an array to a kernel takes as long as reading it for some
    particles.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float32]
    radius: NDArray[np.float32]
    contact_radius: NDArray[np.float32]
    mass: NDArray[np.float32]
    inverse_mass: NDArray[np.float32]
    friction: NDArray[np.float32]
    rolling_friction: NDArray[np.float32]
    cohesion: NDArray[np.float32]
    tool_friction: NDArray[np.float32]
    tool_rolling_friction: NDArray[np.float32]
    adhesion: NDArray[np.float32]
    penetration_limited: NDArray[np.bool_]
    ground_spring: NDArray[np.float32]
    ground_overlap: NDArray[np.float32]
    settle_timer: NDArray[np.float32]
    sleep_state: NDArray[np.int16]
    plate_list_row: NDArray[np.int32]

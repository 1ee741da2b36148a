"""Stiffness of the ground below sprocket and idler, where a machine that tips stands.

The wheels are not sprung: below them only the ground yields. If it were as soft there as below
one shoe, the machine would tilt before it tips, and tip several degrees too early.
"""

from __future__ import annotations

import math

from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.track_state import ContactCoefficients
from msg_bridge.contract.constants import GRAVITY

__all__ = ["axle_coefficients"]

_STIFF_LENGTH = 1.0
"""Length of the belt that is as stiff as the ground below an axle [m]."""


def axle_coefficients(spec: MachineSpec, max_stiff_load: float) -> ContactCoefficients:
    """Return the coefficients of each of the two contact points below an axle.

    Args:
        spec: the machine.
        max_stiff_load: load up to which a contact point is that stiff, as a fraction of the
            machine's weight. When the machine tips, four points carry it together with the shoes
            next to them; where a track hits a step, more load is an impact that shakes the machine.
    """
    tracks = spec.tracks
    ratio = _STIFF_LENGTH / tracks.pitch
    return ContactCoefficients(
        normal_stiffness=0.5 * ratio * tracks.normal_stiffness,
        normal_damping=0.5 * math.sqrt(ratio) * tracks.normal_damping,
        tangential_stiffness=0.5 * tracks.tangential_stiffness,
        tangential_damping=0.5 * tracks.tangential_damping,
        friction=tracks.friction,
        max_stiff_load=max_stiff_load * spec.mass * GRAVITY,
        residual_stiffness=0.5 * tracks.normal_stiffness,
    )

"""Actuators of a machine: its joints, then its two tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # at run time the import would load the physics engine
    from machine_sim.machine.spec import JointLimits, MachineSpec

__all__ = ["TRACK_NAMES", "Actuator", "list_actuators"]

TRACK_NAMES = ("left_track", "right_track")
"""Names of the tracks in commands that name their actuators."""


@dataclass(frozen=True)
class Actuator:
    """One joint or track.

    Attributes:
        name: name of the joint, or one of `TRACK_NAMES`.
        max_speed: maximum speed [`unit`].
        unit: rad/s or m/s.
        limits: limits of a joint; None for a track.
    """

    name: str
    max_speed: float
    unit: str
    limits: JointLimits | None


def list_actuators(spec: MachineSpec) -> tuple[Actuator, ...]:
    """Return the joints in the order of the machine file, then the left and the right track."""
    joints = [
        Actuator(name, limits.max_velocity, "rad/s", limits) for name, limits in spec.joints.items()
    ]
    tracks = [Actuator(name, spec.tracks.max_speed, "m/s", None) for name in TRACK_NAMES]
    return (*joints, *tracks)

"""What of a machine can be commanded: its joints, then its two tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # at run time the machine's package would load the physics engine
    from machine_sim.machine.spec import JointLimits, MachineSpec

__all__ = ["TRACK_NAMES", "Actuator", "list_actuators"]

TRACK_NAMES = ("left_track", "right_track")
"""Names of the tracks in a command that names its actuators."""


@dataclass(frozen=True)
class Actuator:
    """One joint or track.

    Attributes:
        name: of the joint, or one of `TRACK_NAMES`.
        max_speed: greatest speed [`unit`].
        unit: rad/s or m/s.
        limits: of a joint; None for a track.
    """

    name: str
    max_speed: float
    unit: str
    limits: JointLimits | None


def list_actuators(spec: MachineSpec) -> tuple[Actuator, ...]:
    """The joints in the description's order, then left, right track."""
    joints = [
        Actuator(name, limits.max_velocity, "rad/s", limits) for name, limits in spec.joints.items()
    ]
    tracks = [Actuator(name, spec.tracks.max_speed, "m/s", None) for name in TRACK_NAMES]
    return (*joints, *tracks)

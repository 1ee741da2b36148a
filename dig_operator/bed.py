"""The bed of a dumper: its shape, its link and the joint that raises it."""

from __future__ import annotations

from machine_sim.machine import MachineError, MachineSpec
from machine_sim.machine.tools.bed import BedShape

__all__ = ["EMPTY_FILL", "bed_joint", "bed_of", "has_bed"]

EMPTY_FILL = 0.02
"""Fill of a bed at which it counts as empty, and change of the fill that begins a load."""


def has_bed(spec: MachineSpec) -> bool:
    """Return whether a machine has a bed."""
    return any(isinstance(tool.shape, BedShape) for tool in spec.tools.values())


def bed_of(spec: MachineSpec) -> tuple[str, BedShape]:
    """Return the name of the link that carries the bed of a machine, and the bed's shape.

    Raises:
        MachineError: it has no bed.
    """
    for tool in spec.tools.values():
        if isinstance(tool.shape, BedShape):
            return tool.link, tool.shape
    raise MachineError(f"the {spec.name} has no bed; load a machine with a tool of kind bed")


def bed_joint(spec: MachineSpec) -> int:
    """Return the index of the joint that raises the bed of a machine.

    Raises:
        MachineError: it has no bed, or one that does not move.
    """
    link, _ = bed_of(spec)
    for k, joint in enumerate(spec.joints.values()):
        if joint.child == link:
            return k
    raise MachineError(f"the bed of the {spec.name} has no joint; put it on a link that tips")

"""Bodies of the tools on a link, from the tools' own dimensions."""

from __future__ import annotations

import numpy as np

from machine_sim.machine.box import Box
from machine_sim.machine.shapes.bed_solids import bed_solids
from machine_sim.machine.shapes.bucket_solids import bucket_solids
from machine_sim.machine.shapes.drum_solids import drum_solids
from machine_sim.machine.shapes.shape import rotation_from_rpy
from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.solids import box
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape

__all__ = ["box_solid", "tool_solids"]


def tool_solids(spec: MachineSpec, link: str) -> list[Solid]:
    """Return the bodies of all tools on a link, in its frame.

    A kind of tool without bodies of its own is drawn as its boxes.
    """
    solids: list[Solid] = []
    for mount in spec.tools.values():
        if mount.link != link:
            continue
        shape = mount.shape
        if isinstance(shape, BucketShape):
            solids += bucket_solids(shape, _linkage_pins(spec, link))
        elif isinstance(shape, BedShape):
            solids += bed_solids(shape)
        elif isinstance(shape, DrumShape):
            solids += drum_solids(shape)
        else:
            solids += [box_solid(each, "worn_steel") for each in shape.boxes()]
    return solids


def box_solid(each: Box, material: str, radius: float = 0.0) -> Solid:
    """Return a box of a link as a body."""
    turn = rotation_from_rpy((0.0, each.pitch, 0.0))
    return Solid(material, box(each.size, radius).moved(turn, np.array(each.center)))


def _linkage_pins(spec: MachineSpec, link: str) -> list[tuple[float, float]]:
    """Return x, z [m] of the pins at which cylinders move a link, in its frame."""
    pins = []
    for name, cylinder in spec.cylinders.items():
        if spec.joints[name].child == link:
            linkage = cylinder.linkage
            pin = linkage.rod if linkage.rocker is None else linkage.rocker.coupler_pin
            pins += [] if pin is None else [pin]
    return pins

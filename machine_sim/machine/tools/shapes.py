"""Tools: what of a machine touches soil, and the link that it is fixed to."""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape

__all__ = ["ContainerShape", "CuttingShape", "ToolMount", "ToolShape"]

ToolShape = BucketShape | DrumShape | BedShape
CuttingShape = BucketShape | DrumShape
"""Those that go into the ground."""
ContainerShape = BucketShape | BedShape
"""Those that soil is carried in."""


class ToolMount(NamedTuple):
    """A tool and the link it is fixed to, whose frame is the tool's."""

    link: str
    shape: ToolShape

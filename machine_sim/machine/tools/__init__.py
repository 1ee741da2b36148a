"""Tools: the parts of a machine in contact with soil.

- `shapes`: protocols of tool shapes, and the registry of kinds that machine files name
- `open_container`: common base of `bucket` and `bed`
- `bucket`, `bed`, `drum`, `blade`: the shapes
- `tool`: a tool in pybullet
"""

from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.blade import BladeShape
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.machine.tools.shapes import (
    TOOL_SHAPES,
    ContainerShape,
    CuttingShape,
    PlateCuttingShape,
    ToolMount,
    ToolShape,
)

__all__ = [
    "TOOL_SHAPES",
    "BedShape",
    "BladeShape",
    "BucketShape",
    "ContainerShape",
    "CuttingShape",
    "DrumShape",
    "PlateCuttingShape",
    "ToolMount",
    "ToolShape",
]

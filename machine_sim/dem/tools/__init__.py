"""Tools: rigid bodies of thin plates that machines move and particles push back on.

- `pose`: poses, twists and wrenches as packed records, and their interpolation within a step
- `plane`: packed planes
- `plates`: convex polygons, and the closest point of one to a particle centre
- `convex_hull`: half-spaces of the convex hull of a tool's corners
- `rigid_tool`: one tool
- `tool_set`: all tools of an engine in one step, as arrays for the kernels
- `near_tools`: particles near each tool, in its frame, and those inside it
"""

from machine_sim.dem.tools.plates import Plates
from machine_sim.dem.tools.pose import Pose
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import ToolMotion, ToolSet

__all__ = ["Plates", "Pose", "RigidTool", "ToolMotion", "ToolSet"]

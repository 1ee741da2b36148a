"""One machine, from a data file: description, kinematics, tracks, tools, physics.

- `description`: the machine as data; `file/` reads it from YAML
- `tools/`: buckets, drums and beds; `tracks/`: two models of them, on ground that gives
- `urdf`: the same machine as URDF text; `appearance`: what it looks like, and where each link is
- `kinematics`: an excavator's joint angles to tool pose and back, without a physics engine
- `linkage`, `hydraulics`: cylinders between links, what feeds them, how fast and hard they move
- `pistons`: what is seen of them
- `link_motion`: how every link moves
- `joints`: ramps and limits of commanded joint speeds
- `tracked_machine`: all of it in pybullet, stepped by its owner
"""

from machine_sim.machine.description import (
    Joint,
    JointLimits,
    LinkShape,
    MachineDescription,
    TrackShape,
)
from machine_sim.machine.errors import MachineError, ReachError
from machine_sim.machine.file.machine import load_description
from machine_sim.machine.kinematics import (
    EXCAVATOR_JOINTS,
    arm_angles,
    arm_geometry,
    from_arm_plane,
    rotation_matrix,
    swing_toward,
    to_arm_plane,
    tool_point,
    tool_pose,
)
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.tool import Tool
from machine_sim.machine.tracked_machine import TrackedMachine
from machine_sim.machine.tracks.fast import FastTracks
from machine_sim.machine.tracks.hinged import HingedTracks
from machine_sim.machine.tracks.model import TrackModel, Tracks, fitted_with
from machine_sim.machine.urdf import urdf_text

__all__ = [
    "EXCAVATOR_JOINTS",
    "BucketShape",
    "FastTracks",
    "HingedTracks",
    "Joint",
    "JointLimits",
    "LinkShape",
    "MachineDescription",
    "MachineError",
    "ReachError",
    "Tool",
    "TrackModel",
    "TrackShape",
    "TrackedMachine",
    "Tracks",
    "arm_angles",
    "arm_geometry",
    "fitted_with",
    "from_arm_plane",
    "load_description",
    "rotation_matrix",
    "swing_toward",
    "to_arm_plane",
    "tool_point",
    "tool_pose",
    "urdf_text",
]

"""One machine, from a data file: description, kinematics, tracks, tools, physics.

- `description`: the machine as data; `machine_file`, `cylinder_file`, `tool_file` read it from YAML
- `tools`: what touches soil: `bucket`, `bed` (both a `trough`), `drum`; `tool_boxes`: as seen
- `urdf`: the same machine as URDF text
- `kinematics`: an excavator's joint angles to tool pose and back, without a physics engine
- `linkage`, `hydraulics`: cylinders between links, what feeds them, how fast and hard they move
- `pistons`: what is seen of them
- `link_motion`: how every link moves
- `joints`: ramps and limits of commanded joint speeds
- `tracks`: what all tracks have in common; `shoe_contact`: a shoe on soil; `fast_tracks`,
  `track_contact`: belts on their path; `hinged_tracks`, `hinged_chain`, `hinged_gear`,
  `hinged_contact`: rigid shoes, hinged and driven
- `tracked_machine`: all of it in pybullet, stepped by its owner; `tool`: its tools there
"""

from machine_sim.machine.bucket import BucketShape
from machine_sim.machine.description import (
    Joint,
    JointLimits,
    LinkShape,
    MachineDescription,
    TrackShape,
)
from machine_sim.machine.errors import MachineError, ReachError
from machine_sim.machine.fast_tracks import FastTracks
from machine_sim.machine.hinged_tracks import HingedTracks
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
from machine_sim.machine.machine_file import load_description
from machine_sim.machine.tool import Tool
from machine_sim.machine.tracked_machine import TrackedMachine
from machine_sim.machine.tracks import TrackModel, Tracks, fitted_with
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

"""One excavator, from a data file: description, kinematics, tracks, physics.

- `description`: the machine as data, read from YAML (`load_description`)
- `bucket`: plates, key points and capacities of its tool
- `urdf`: the same machine as URDF text
- `kinematics`: joint angles to tool pose and back, without a physics engine
- `linkage`, `hydraulics`: cylinders between links, what feeds them, how fast and hard they move
- `pistons`: what is seen of them
- `link_motion`: how every link moves
- `joints`: ramps and limits of commanded joint speeds
- `tracks`: what all tracks have in common; `fast_tracks`, `track_contact`: belts on their path;
  `hinged_tracks`, `hinged_chain`, `hinged_gear`, `hinged_contact`: rigid shoes, hinged and driven
- `excavator`: all of it in pybullet, stepped by its owner
"""

from machine_sim.machine.bucket import BucketShape
from machine_sim.machine.description import (
    JOINT_NAMES,
    JointLimits,
    LinkShape,
    MachineDescription,
    TrackShape,
    load_description,
)
from machine_sim.machine.errors import MachineError, ReachError
from machine_sim.machine.excavator import Excavator
from machine_sim.machine.fast_tracks import FastTracks
from machine_sim.machine.hinged_tracks import HingedTracks
from machine_sim.machine.kinematics import (
    arm_angles,
    from_arm_plane,
    rotation_matrix,
    swing_toward,
    to_arm_plane,
    tool_point,
    tool_pose,
)
from machine_sim.machine.tracks import TrackModel, Tracks, fitted_with
from machine_sim.machine.urdf import urdf_text

__all__ = [
    "JOINT_NAMES",
    "BucketShape",
    "Excavator",
    "FastTracks",
    "HingedTracks",
    "JointLimits",
    "LinkShape",
    "MachineDescription",
    "MachineError",
    "ReachError",
    "TrackModel",
    "TrackShape",
    "Tracks",
    "arm_angles",
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

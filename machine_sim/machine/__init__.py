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

from machine_sim.machine.arm_kinematics import (
    EXCAVATOR_JOINTS,
    arm_geometry,
    map_to_swing_frame,
    solve_arm_angles,
    swing_angle_toward,
    swing_frame_to_map,
    tool_point,
    tool_pose,
)
from machine_sim.machine.errors import MachineError, ReachError
from machine_sim.machine.rotations import rotation_matrix
from machine_sim.machine.spec import (
    Joint,
    JointLimits,
    LinkSpec,
    MachineSpec,
    TrackSpec,
)
from machine_sim.machine.spec_file import load_machine_spec
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.tool import Tool
from machine_sim.machine.tracked_machine import TrackedMachine
from machine_sim.machine.tracks import (
    DynamicTracks,
    KinematicTracks,
    TrackModel,
    Tracks,
    with_track_model,
)
from machine_sim.machine.urdf import urdf_text

__all__ = [
    "EXCAVATOR_JOINTS",
    "BucketShape",
    "DynamicTracks",
    "Joint",
    "JointLimits",
    "KinematicTracks",
    "LinkSpec",
    "MachineError",
    "MachineSpec",
    "ReachError",
    "Tool",
    "TrackModel",
    "TrackSpec",
    "TrackedMachine",
    "Tracks",
    "arm_geometry",
    "load_machine_spec",
    "map_to_swing_frame",
    "rotation_matrix",
    "solve_arm_angles",
    "swing_angle_toward",
    "swing_frame_to_map",
    "tool_point",
    "tool_pose",
    "urdf_text",
    "with_track_model",
]

"""One machine, from its YAML file: specification, kinematics, tools, tracks, physics.

- `spec`: the specification; `spec_file/` reads it from YAML; `box`: boxes of its links
- `tools/`: shapes of buckets, beds, drums and blades, and tools in pybullet
- `arm_kinematics`: closed-form kinematics of an excavator's arm
- `forward_kinematics`, `link_motion`: poses and velocities of all links; `rotations`: matrices and
  quaternions; `rotated_vectors`: products of matrices and vectors in kernels
- `base_motion`: pose and motion of the base as one array
- `cylinder_linkage`, `hydraulic_cylinder`: geometry of cylinders; `hydraulics`: all cylinders,
  `hydraulic_motor`s and their `hydraulic_supply`: flow, force and pressure
- `joint_reference`: speed ramps of the joints that stop at their limits
- `actuator_step`: one kernel for valves, pumps, references and torque limits; the tables that it
  takes are in `joint_table` and `hydraulic_tables`, its parts in `hydraulic_kernels` and
  `linkage_kernels`
- `tracks/`: two models of the tracks on deformable ground
- `tracked_machine`, `multibody`: the machine in pybullet, stepped by its owner
- `urdf`, `visuals`: URDF text for the physics, and boxes for markers
- `shapes/`: visual shapes as meshes; `cylinder_visuals`, `track_wheels`: links that are only shown
- `description`: URDF text of the robot description, with the meshes
- `validation`, `errors`: checks of numbers given by a caller, and the errors of this package
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
from machine_sim.machine.spec_file import find_shapes_file, load_machine_spec
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
    "find_shapes_file",
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

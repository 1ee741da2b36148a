"""A scripted operator that works from public topics alone: it digs, carries and dumps.

What the operator observes and commands:

- `observation`: Observation, Command, and the low-pass filter of the base pose
- `sample_synchronizer`: the messages of one tick, collected until they are complete
- `observation_builder`: an Observation from these messages
- `observed_machine`, `other_machines`, `machine_topics`: other machines, from their topics
- `params`, `face_params`, `haul_params`: parameters of the behaviour and of the tasks
- `phases`: OperatorPhase

An excavator digs:

- `bucket_kinematics`: joint angles for a pose of the bucket, and back
- `terrain_survey`: where to dig and how high to swing, from the observed terrain
- `dig_plan`: path of the lip that sweeps a given volume of soil
- `cycle_waypoints`: waypoints of the bucket for each phase of the dig cycle
- `waypoint_follower`, `swing_follower`: joint velocities that follow waypoints, and a swing
- `bed`, `dump_target`: the bed of a dumper; where to dump: on the ground or into such a bed
- `dig_cycle`: state machine of one cycle: reach, dig, curl, lift, swing, dump
- `dig_task`: state machine of the task: approach, so many cycles, wait until all soil is at rest

A road header cuts a face:

- `face_geometry`: rows of a face and the boom angles that reach them
- `face_cutting`: state machine that cuts the face in passes

A dumper hauls:

- `track_drive`: track speeds along lines and in turns on the spot, clear of other machines
- `haul_task`: state machine that is loaded, hauls, tips and returns; `load_report`: its result

- `node_params`, `node`: the operator as a ROS 2 node
"""

from dig_operator.dig_cycle import CycleReport, DigCycle
from dig_operator.dig_task import DigTask
from dig_operator.face_cutting import FaceCuttingTask
from dig_operator.face_params import FaceCuttingParams
from dig_operator.haul_params import HaulTaskParams
from dig_operator.haul_task import HaulTask
from dig_operator.load_report import LoadReport
from dig_operator.observation import Command, Observation
from dig_operator.params import BehaviourParams, DigTaskParams
from dig_operator.phases import OperatorPhase

__all__ = [
    "BehaviourParams",
    "Command",
    "CycleReport",
    "DigCycle",
    "DigTask",
    "DigTaskParams",
    "FaceCuttingParams",
    "FaceCuttingTask",
    "HaulTask",
    "HaulTaskParams",
    "LoadReport",
    "Observation",
    "OperatorPhase",
]

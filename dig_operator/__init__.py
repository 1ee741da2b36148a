"""A scripted operator: digs, carries and dumps, knowing only what public topics carry.

- `view`: what it sees and what it does.
- `arm`: joints for a place of the bucket, and back.
- `survey`: what it takes from the terrain: where to dig, how high to swing.
- `dig`: where the lip should go to fill the bucket.
- `motion`: following way points with velocity commands.
- `cycle`: dig, lift, swing, dump, return.
- `shift`: drive up, dig so many bucketfuls, wait until all soil lies.
- `face`: a road header's task: cut a face in passes.
- `eyes`: the view, put together from what each topic told.
- `node`: the operator as a ROS 2 node.
"""

from dig_operator.dig_cycle import CycleReport, DigCycle
from dig_operator.dig_task import DigTask
from dig_operator.face_cutting import FaceCuttingParams, FaceCuttingTask
from dig_operator.observation import Command, Observation
from dig_operator.params import BehaviourParams, DigTaskParams

__all__ = [
    "BehaviourParams",
    "Command",
    "CycleReport",
    "DigCycle",
    "DigTask",
    "DigTaskParams",
    "FaceCuttingParams",
    "FaceCuttingTask",
    "Observation",
]

"""Contents of `dig_operator --help`."""

from __future__ import annotations

from dig_operator.face_params import FaceCuttingParams
from dig_operator.haul_params import HaulTaskParams
from dig_operator.node_params import DigOperatorNodeParams
from dig_operator.params import BehaviourParams, DigTaskParams
from msg_bridge.nodes.node_usage import NodeUsage

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Operate a machine through its topics: an excavator digs and dumps, a road header cuts a face,"
    " a dumper hauls."
    " The node runs in the machine's namespace (-r __ns:=/excavator) and ends with its task.",
    parameters={
        "": DigOperatorNodeParams,
        "behaviour.": BehaviourParams,
        "task.": DigTaskParams,
        "face.": FaceCuttingParams,
        "haul.": HaulTaskParams,
    },
)

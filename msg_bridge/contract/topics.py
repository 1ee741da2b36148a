"""Names of all topics and services, each in one place.

Every name is relative to one of three namespaces, so that several simulations run side by side in
one ROS domain:

- the namespace of the *simulation*, which is that of its soil node: `/` unless it is given;
- the namespace of a *machine node*, one level below it: `/excavator` by default;
- the namespace of a *machine*: that of its node, or one level below it where a node has several.

`msg_bridge.contract.interface` lists each with its type, QoS and rate.
"""

from __future__ import annotations

from collections.abc import Container
from typing import Final

from msg_bridge.contract.messages import Stream

__all__ = [
    "APPLIED_COMMANDS",
    "CLOCK",
    "CMD_VEL",
    "CONTACTS",
    "CONVERSION_BACKLOG",
    "CYLINDERS",
    "DIAGNOSTICS",
    "EMERGENCY_STOP",
    "FRONT_VELOCITY_COMMANDS",
    "JOINT_COMMANDS",
    "JOINT_STATES",
    "JOY",
    "MACHINE_CONFIG",
    "MACHINE_STATE_HASH",
    "MACHINE_TICK",
    "MAP_FRAME",
    "MARKERS",
    "MEASURED_JOINT_STATES",
    "ODOM",
    "OPERATOR_CYCLES",
    "OPERATOR_PHASE",
    "PARTICLES",
    "PAUSE_SERVICE",
    "PAYLOAD",
    "RECORDER_STATUS",
    "RELEASE_SERVICE",
    "RESET_SERVICE",
    "ROBOT_DESCRIPTION",
    "SAVE_SERVICE",
    "SIM_CONFIG",
    "SIM_PAUSED",
    "SOIL_CONVERSIONS",
    "SOIL_CUT_FILL",
    "SOIL_DEPOSIT_REQUESTS",
    "SOIL_FORCES",
    "SOIL_JOIN_REJECTIONS",
    "SOIL_LEDGER",
    "SOIL_STATE_HASH",
    "SOIL_TICK",
    "SOIL_TOOL_SWEEPS",
    "STEP_SERVICE",
    "STREAM_TOPICS",
    "TERRAIN_ELEVATION",
    "TERRAIN_GRID_MAP",
    "TERRAIN_INFO",
    "TERRAIN_MAP",
    "TERRAIN_MAP_UPDATES",
    "TERRAIN_SURFACE_TILT",
    "TERRAIN_TILES",
    "TERRAIN_VIEW",
    "TF",
    "TRACK_VELOCITY_COMMANDS",
    "TRANSFORMS",
    "VERIFY_SERVICE",
    "bin_markers_topic",
    "bin_payload_topic",
    "camera_topics",
    "imu_topic",
    "machine_node_namespace",
    "parent_namespace",
    "resolve",
    "simulation_namespace_of_machine",
    "wrench_topic",
]

MAP_FRAME: Final = "map"
"""Frame of the terrain, of particles and of all rows."""

# In the namespace of the simulation.

CLOCK: Final = "clock"
TERRAIN_MAP: Final = "terrain/map"
TERRAIN_ELEVATION: Final = "terrain/elevation"
TERRAIN_INFO: Final = "terrain/info"
TERRAIN_GRID_MAP: Final = "terrain/grid_map"
TERRAIN_MAP_UPDATES: Final = "terrain/map_updates"
TERRAIN_TILES: Final = "terrain/tiles"
"""Parts of the map of a large terrain, which is not published as a whole."""
TERRAIN_VIEW: Final = "terrain/view"
"""The terrain with fewer columns, for display."""
TERRAIN_SURFACE_TILT: Final = "terrain/surface_tilt"
SOIL_TICK: Final = "soil/tick"
"""Headers of the soil, and its retransmit requests to machines."""
SOIL_TOOL_SWEEPS: Final = "soil/tool_sweeps"
SOIL_DEPOSIT_REQUESTS: Final = "soil/deposit_requests"
SOIL_CONVERSIONS: Final = "soil/conversions"
SOIL_FORCES: Final = "soil/forces"
SOIL_JOIN_REJECTIONS: Final = "soil/join_rejections"
SOIL_LEDGER: Final = "soil/ledger"
SOIL_STATE_HASH: Final = "soil/state_hash"
SOIL_CUT_FILL: Final = "soil/cut_fill"
SIM_CONFIG: Final = "sim/config"
SIM_PAUSED: Final = "sim/paused"
RECORDER_STATUS: Final = "recorder/status"
DIAGNOSTICS: Final = "diagnostics"
TF: Final = "tf"

RESET_SERVICE: Final = "sim/reset"
PAUSE_SERVICE: Final = "sim/pause"
STEP_SERVICE: Final = "sim/step"
VERIFY_SERVICE: Final = "soil/verify"
SAVE_SERVICE: Final = "soil/save"
RELEASE_SERVICE: Final = "soil/release"

STREAM_TOPICS: Final[dict[Stream, str]] = {
    Stream.SWEEP: SOIL_TOOL_SWEEPS,
    Stream.DEPOSIT_REQUEST: SOIL_DEPOSIT_REQUESTS,
    Stream.CONVERSION: SOIL_CONVERSIONS,
    Stream.MAP_UPDATE: TERRAIN_MAP_UPDATES,
    Stream.FORCE: SOIL_FORCES,
}
"""Topic of each stream of rows that the machines of a simulation share."""

# In the namespace of a machine node.

MACHINE_TICK: Final = "soil_tick"
"""Headers of a machine node, and its retransmit requests to the soil."""
CONVERSION_BACKLOG: Final = "conversion_backlog"
"""Conversion rows from before a machine node rejoined."""
PARTICLES: Final = "particles"
MACHINE_STATE_HASH: Final = "state_hash"
MACHINE_CONFIG: Final = "config"
CONTACTS: Final = "contacts"
"""Contacts between the machines of a node."""

# In the namespace of a machine.

FRONT_VELOCITY_COMMANDS: Final = "front_velocity_controller/commands"
TRACK_VELOCITY_COMMANDS: Final = "track_velocity_controller/commands"
JOINT_COMMANDS: Final = "joint_commands"
CMD_VEL: Final = "cmd_vel"
JOY: Final = "joy"
EMERGENCY_STOP: Final = "emergency_stop"
APPLIED_COMMANDS: Final = "applied_commands"
JOINT_STATES: Final = "joint_states"
MEASURED_JOINT_STATES: Final = "joint_states_measured"
ODOM: Final = "odom"
CYLINDERS: Final = "cylinders"
TRACKS: Final = "tracks"
PAYLOAD: Final = "payload"
TRANSFORMS: Final = "transforms"
MARKERS: Final = "markers"
ROBOT_DESCRIPTION: Final = "robot_description"
OPERATOR_PHASE: Final = "operator/phase"
OPERATOR_CYCLES: Final = "operator/cycles"


def imu_topic(imu: str) -> str:
    """Return the topic of an inertial unit."""
    return f"imu/{imu}/data"


def wrench_topic(tool: str) -> str:
    """Return the topic of the soil's reaction on a tool."""
    return f"{tool}/wrench"


def camera_topics(camera: str) -> tuple[str, str]:
    """Return the topics of the images of a camera, and of its intrinsic matrices."""
    return f"camera/{camera}/image", f"camera/{camera}/camera_info"


def bin_markers_topic(name: str) -> str:
    """Return the topic of a bin's markers, in the namespace of its machine node."""
    return f"{name}/markers"


def bin_payload_topic(name: str) -> str:
    """Return the topic of what a bin holds, in the namespace of its machine node."""
    return f"{name}/{PAYLOAD}"


# Namespaces.


def resolve(name: str, namespace: str) -> str:
    """Return the absolute name of a relative `name` in a namespace."""
    return f"{namespace.rstrip('/')}/{name}"


def parent_namespace(namespace: str) -> str:
    """Return the namespace one level up: of `/a/b` it is `/a`, of `/a` and of `/` it is `/`."""
    return namespace.rstrip("/").rpartition("/")[0] or "/"


def machine_node_namespace(topic: str, simulation_namespace: str) -> str | None:
    """Return the namespace of the machine node that publishes a topic.

    Args:
        topic: an absolute name.
        simulation_namespace: of the soil node.

    Returns:
        The namespace; None if the topic is not the headers of a machine node of that simulation.
    """
    namespace, _, name = topic.rpartition("/")
    if name != MACHINE_TICK or not namespace:
        return None
    return namespace if parent_namespace(namespace) == (simulation_namespace or "/") else None


def simulation_namespace_of_machine(topic: str, known_topics: Container[str]) -> str:
    """Return the namespace of the simulation that a machine belongs to.

    Args:
        topic: absolute name of a topic of the machine, such as `/excavator/transforms`.
        known_topics: names of the topics of the graph; headers of machine nodes among them show
            whether the machine's namespace is that of its node or one level below it.
    """
    namespace = parent_namespace(topic)
    node_namespace = namespace
    while node_namespace != "/":
        if resolve(MACHINE_TICK, node_namespace) in known_topics:
            return parent_namespace(node_namespace)
        node_namespace = parent_namespace(node_namespace)
    return parent_namespace(namespace)

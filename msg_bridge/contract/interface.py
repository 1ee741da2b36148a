"""The public interface: every topic and service with its type, namespace, QoS, rate and meaning.

This table is the one description of the interface. The help texts of the nodes and
`docs/interfaces.md` are generated from it, and a test compares it with the endpoints that the nodes
create. Names are in `msg_bridge.contract.topics`, layouts of rows in `msg_bridge.contract.rows`.
"""

from __future__ import annotations

import re
from functools import lru_cache

from msg_bridge.contract import topics
from msg_bridge.contract.endpoint import Endpoint, EndpointKind, Scope

__all__ = [
    "INTERFACE",
    "Endpoint",
    "EndpointKind",
    "Scope",
    "endpoints_of",
    "holds_state",
    "is_exclusive",
]

SOIL, MACHINE, OPERATOR, RECORDER = "soil_sim", "machine_sim", "dig_operator", "exchange_recorder"
VIEWER, CAMERA = "viewer", "camera"
"""Executables of this package."""

_PAGES = (VIEWER, CAMERA)
"""Executables that show the simulation on the live page."""

ANY = "any client"
"""A publisher or caller outside of this package."""


_SIM, _NODE, _MACHINE = Scope.SIMULATION, Scope.MACHINE_NODE, Scope.MACHINE
_CLOUD, _ARRAY = "sensor_msgs/msg/PointCloud2", "std_msgs/msg/Int64MultiArray"
_FLOATS, _STRING = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/String"
_JOINTS = "sensor_msgs/msg/JointState"

_COMMANDS = (
    Endpoint(
        topics.FRONT_VELOCITY_COMMANDS, _FLOATS, _MACHINE, (ANY,), (MACHINE,), "COMMANDS",
        "up to once a tick", "joint velocities [rad/s] in the order of the machine file",
    ),
    Endpoint(
        topics.TRACK_VELOCITY_COMMANDS, _FLOATS, _MACHINE, (ANY,), (MACHINE,), "COMMANDS",
        "up to once a tick", "track speeds [m/s]: left, right",
    ),
    Endpoint(
        topics.JOINT_COMMANDS, _JOINTS, _MACHINE, (ANY, OPERATOR), (MACHINE,), "COMMANDS",
        "up to once a tick",
        "names with `velocity` [rad/s, m/s], or with `position` [rad] to go to and hold; partial"
        " lists are allowed; tracks are `left_track` and `right_track`",
    ),
    Endpoint(
        topics.CMD_VEL, "geometry_msgs/msg/TwistStamped", _MACHINE, (ANY,), (MACHINE,), "COMMANDS",
        "up to once a tick", "linear.x [m/s] and angular.z [rad/s], converted to track speeds",
    ),
    Endpoint(
        topics.JOY, "sensor_msgs/msg/Joy", _MACHINE, (ANY, VIEWER), (MACHINE,), "COMMANDS",
        "up to once a tick", "joystick axes, in the pattern `commands.joy_pattern` (iso or sae)",
    ),
    Endpoint(
        topics.EMERGENCY_STOP, "std_msgs/msg/Bool", _MACHINE, (ANY, VIEWER), (MACHINE, *_PAGES),
        "STATE", "on change",
        "true stops all motion until false arrives; publishers of any reliability and durability"
        " are received, and a transient-local one also by a machine that starts later",
    ),
)  # fmt: skip

_MACHINE_STATE = (
    Endpoint(
        topics.APPLIED_COMMANDS, _JOINTS, _MACHINE, (MACHINE,), _PAGES, "ROWS", "every tick",
        "command that took effect in the tick: velocities of joints [rad/s] and tracks [m/s], as"
        " commanded: the machine limits them",
    ),
    Endpoint(
        topics.JOINT_STATES, _JOINTS, _MACHINE, (MACHINE,), (OPERATOR, *_PAGES), "STATE",
        "`state_rate`, 50 Hz",
        "position [rad], velocity [rad/s] and effort (torque of the drive, mean over the physics"
        " steps of the tick, [N m]) of all joints, with the sprockets (`left_sprocket`,"
        " `right_sprocket`: travel of the belt since the start of the run over its radius, not"
        " wrapped), the joints of the cylinders and the virtual joints of the base (`base_x` ..."
        " `base_roll`), both without effort",
    ),
    Endpoint(
        topics.ODOM, "nav_msgs/msg/Odometry", _MACHINE, (MACHINE,), (OPERATOR, *_PAGES), "STATE",
        "`state_rate`, 50 Hz", "pose of `base_link` in `map` and its twist; exact",
    ),
    Endpoint(
        topics.CYLINDERS, _FLOATS, _MACHINE, (MACHINE,), _PAGES, "STATE", "`state_rate`, 50 Hz",
        "labelled: length [m], speed [m/s], force (mean over the physics steps of the tick, [N])"
        " and pressures of cap and rod side at this force [Pa] of each cylinder, time [s]",
    ),
    Endpoint(
        topics.TRACKS, _FLOATS, _MACHINE, (MACHINE,), (), "STATE", "`state_rate`, 50 Hz",
        "labelled: slip (mean of 0.5 s), sinkage [m], speed of the belt [m/s] and force of its"
        " drive (mean over the physics steps of the tick, [N]) of the left and the right track,"
        " time [s]",
    ),
    Endpoint(
        topics.PAYLOAD, _FLOATS, _MACHINE, (MACHINE,), (OPERATOR, *_PAGES), "STATE",
        "`state_rate`, 50 Hz",
        "labelled: bank and loose volume [m³], mass [kg] and fill [heaped capacity = 1] of the soil"
        " that the machine carries, time [s]",
        "the machine has a tool that carries soil",
    ),
    Endpoint(
        topics.wrench_topic("<tool>"), "geometry_msgs/msg/WrenchStamped", _MACHINE, (MACHINE,), (),
        "STATE", "`state_rate`, 50 Hz",
        "force [N] and torque [N m] of the soil on a tool, in the tool's frame",
    ),
    Endpoint(
        topics.imu_topic("<imu>"), "sensor_msgs/msg/Imu", _MACHINE, (MACHINE,), (), "STATE",
        "`sensors.rate`, 50 Hz", "measurement of an inertial unit, with noise, bias and delay",
    ),
    Endpoint(
        topics.MEASURED_JOINT_STATES, _JOINTS, _MACHINE, (MACHINE,), (), "STATE",
        "`sensors.rate`, 50 Hz", "measurement of the joint encoders, with noise, bias and delay",
    ),
    Endpoint(
        topics.TRANSFORMS, "geometry_msgs/msg/TransformStamped", _MACHINE, (MACHINE,), (), "ROWS",
        "`transform_rate`, 20 Hz",
        "pose in `map` of each link, cylinder, sprocket, idler and view point, one message each",
    ),
    Endpoint(
        topics.MARKERS, "visualization_msgs/msg/MarkerArray", _MACHINE, (MACHINE,), (), "STATE",
        "`marker_rate`, 10 Hz", "boxes of the machine and its shoes in `map`",
    ),
    Endpoint(
        topics.ROBOT_DESCRIPTION, _STRING, _MACHINE, (MACHINE,), _PAGES, "TRANSIENT_LOCAL",
        "once a run",
        "URDF of the machine, with its meshes unless `description_meshes` is `primitives`; see the"
        " document on machines",
    ),
    Endpoint(
        topics.camera_topics("<camera>")[0], "sensor_msgs/msg/Image", _MACHINE, (CAMERA,), (),
        "STATE", "`rate`, at most 5 Hz",
        "rgb8 image of the camera `cab` or `bucket`, drawn as on the live page; frame"
        " `<camera>_camera_optical`: x right, y down, z forward",
        "the node `camera` runs; drawn while there is a subscriber",
    ),
    Endpoint(
        topics.camera_topics("<camera>")[1], "sensor_msgs/msg/CameraInfo", _MACHINE, (CAMERA,), (),
        "STATE", "with each image", "intrinsic matrices, without distortion",
        "the node `camera` runs; drawn while there is a subscriber",
    ),
    Endpoint(
        topics.OPERATOR_PHASE, _STRING, _MACHINE, (OPERATOR,), _PAGES, "ROWS", "on change",
        "JSON: `time` [s], `cycle`, `phase`, `abort_reason`",
    ),
    Endpoint(
        topics.OPERATOR_CYCLES, _STRING, _MACHINE, (OPERATOR,), (), "ROWS", "once a cycle",
        "JSON report of a finished dig cycle, or of a load; see the document on bags",
    ),
)  # fmt: skip

_MACHINE_NODE = (
    Endpoint(
        topics.MACHINE_TICK, _ARRAY, _NODE, (MACHINE,), (SOIL,), "ROWS", "every tick",
        "labelled: header of the machine node's tick, or a retransmit request",
    ),
    Endpoint(
        topics.CONVERSION_BACKLOG, _CLOUD, _NODE, (SOIL,), (MACHINE,), "ROWS", "at a rejoin",
        "conversion rows from before the rejoin",
        "a machine node has appeared",
    ),
    Endpoint(
        topics.CONTACTS, _STRING, _NODE, (MACHINE,), (), "ROWS",
        "at the start and the end",
        "JSON: `machines` (names of two machines, or of a machine and a bin), `start_time` and"
        " `end_time` [s], `max_force` [N], `position` [m], `is_over`",
        "the node has several machines, or a bin",
    ),
    Endpoint(
        topics.PARTICLES, _CLOUD, _NODE, (MACHINE,), _PAGES, "STATE", "`particle_rate`, 20 Hz",
        "`x y z` [m], `vx vy vz` [m/s], `diameter` [m], `id`, `volume_mm3` and `soil` of each"
        " particle",
    ),
    Endpoint(
        topics.MACHINE_STATE_HASH, _STRING, _NODE, (MACHINE,), (), "STATE", "`hash_rate`, 1 Hz",
        "JSON: `run_id`, `tick`, `stamp` and SHA-256 of machines and particles",
    ),
    Endpoint(
        topics.MACHINE_CONFIG, _STRING, _NODE, (MACHINE,), (OPERATOR, *_PAGES), "TRANSIENT_LOCAL",
        "once a run",
        "YAML: every parameter of the node, and the id of its first session of the run",
    ),
    Endpoint(
        topics.bin_payload_topic("<bin>"), _FLOATS, _NODE, (MACHINE,), (), "STATE",
        "`state_rate`, 50 Hz", "payload of a bin, as that of a machine", "`bins` names one",
    ),
    Endpoint(
        topics.bin_markers_topic("<bin>"), "visualization_msgs/msg/MarkerArray", _NODE, (MACHINE,),
        (), "STATE", "`marker_rate`, 10 Hz", "boxes of a bin in `map`", "`bins` names one",
    ),
)  # fmt: skip

_TERRAIN = (
    Endpoint(
        topics.TERRAIN_MAP, _CLOUD, _SIM, (SOIL,), (MACHINE, OPERATOR, *_PAGES), "TRANSIENT_LOCAL",
        "`map_rate`, at most 2 Hz, if changed",
        "keyframe, organised (rows x cols): `x y z` [m], `loose_depth` [m], `surface_material`,"
        " `moisture` [%], `soil`, `design_difference` [m], `volume_mm3`, `rut_depth` [m],"
        " `revision`, `run_id`",
        "the terrain has at most 513 x 513 columns; else bags have it, made by the recorder",
    ),
    Endpoint(
        topics.TERRAIN_TILES, _CLOUD, _SIM, (SOIL,), (MACHINE, OPERATOR, *_PAGES), "TILES",
        "all for a new subscriber, then at `map_rate`, at most 2 Hz, those that changed",
        "part of a keyframe, organised: the fields of the map, `row`, `col`, `map_rows`,"
        " `map_cols`, `base_revision`, `num_tiles`",
        "the terrain has more than 513 x 513 columns",
    ),
    Endpoint(
        topics.TERRAIN_VIEW, _CLOUD, _SIM, (SOIL,), (), "TRANSIENT_LOCAL",
        "`map_rate`, at most 2 Hz, if changed and subscribed",
        "part of the terrain with fewer columns, organised: `x y z` [m], `loose_depth` [m],"
        " `surface_material`, `moisture` [%], `soil`, `design_difference` [m], `rut_depth` [m]",
    ),
    Endpoint(
        topics.TERRAIN_MAP_UPDATES, _CLOUD, _SIM, (SOIL,), (MACHINE, OPERATOR, *_PAGES), "ROWS",
        "every tick with changes", "MAP_UPDATE rows: every changed cell",
    ),
    Endpoint(
        topics.TERRAIN_ELEVATION, "sensor_msgs/msg/Image", _SIM, (SOIL,), (), "TRANSIENT_LOCAL",
        "with the map", "32FC1: elevation [m] in grid_map matrix order",
        "the terrain has at most 513 x 513 columns",
    ),
    Endpoint(
        topics.TERRAIN_INFO, "nav_msgs/msg/MapMetaData", _SIM, (SOIL,), (), "TRANSIENT_LOCAL",
        "once a run", "cell size [m], number of cells, origin (the -x, -y corner)",
    ),
    Endpoint(
        topics.TERRAIN_GRID_MAP, "grid_map_msgs/msg/GridMap", _SIM, (SOIL,), (),
        "TRANSIENT_LOCAL", "with the map", "the layers of the map",
        "grid_map_msgs is installed; else bags have it, made by the recorder",
    ),
    Endpoint(
        topics.TERRAIN_SURFACE_TILT, "sensor_msgs/msg/Image", _SIM, (SOIL,), (),
        "TRANSIENT_LOCAL", "once a run", "32FC2: slopes along x and y by which loose soil leans",
        "`soil.surface_tilt_noise` is above 0",
    ),
    Endpoint(
        topics.SOIL_CUT_FILL, _FLOATS, _SIM, (SOIL,), (), "TRANSIENT_LOCAL", "with the map",
        "labelled: time [s], volumes to cut, to fill and remaining [m³], cells within tolerance",
        "`site.design` is set",
    ),
)  # fmt: skip

_EXCHANGE = (
    Endpoint(
        topics.SOIL_TOOL_SWEEPS, _CLOUD, _SIM, (MACHINE,), (SOIL,), "ROWS", "every tick",
        "SWEEP rows: key points of tools at the start and the end of the tick",
    ),
    Endpoint(
        topics.SOIL_DEPOSIT_REQUESTS, _CLOUD, _SIM, (MACHINE,), (SOIL,), "ROWS", "every tick",
        "DEPOSIT_REQUEST rows: particles at rest, to become terrain",
    ),
    Endpoint(
        topics.SOIL_CONVERSIONS, _CLOUD, _SIM, (SOIL,), (MACHINE,), "ROWS", "every tick",
        "CONVERSION rows: the volume that was moved, the only record of it",
    ),
    Endpoint(
        topics.SOIL_FORCES, _CLOUD, _SIM, (SOIL,), (MACHINE,), "ROWS", "every tick",
        "FORCE rows: limit force [N] and torque [N m] of the soil on each tool",
    ),
    Endpoint(
        topics.SOIL_TICK, _ARRAY, _SIM, (SOIL,), (MACHINE, OPERATOR), "ROWS", "every tick",
        "labelled: header of the soil's tick, or a retransmit request",
    ),
    Endpoint(
        topics.SOIL_JOIN_REJECTIONS, _STRING, _SIM, (SOIL,), (MACHINE,), "ROWS", "on rejection",
        "JSON: `run_id`, `machine_id`, `session_id`, `reason`",
    ),
    Endpoint(
        topics.SOIL_LEDGER, _ARRAY, _SIM, (SOIL,), (OPERATOR, *_PAGES), "ROWS", "every tick",
        "labelled: every account of the volume and the imbalance [mm³]",
    ),
    Endpoint(
        topics.SOIL_STATE_HASH, _STRING, _SIM, (SOIL,), (), "STATE", "`hash_rate`, 1 Hz",
        "JSON: `run_id`, `tick`, `stamp` and SHA-256 of the terrain",
    ),
)  # fmt: skip

_SIMULATION = (
    Endpoint(
        topics.CLOCK, "rosgraph_msgs/msg/Clock", _SIM, (SOIL,), (RECORDER,), "STATE", "every tick",
        "simulated time",
    ),
    Endpoint(
        topics.SIM_CONFIG, _STRING, _SIM, (SOIL,), (MACHINE, OPERATOR, *_PAGES), "TRANSIENT_LOCAL",
        "once a run", "YAML: run, parameters, versions and seeds, soils, georeference",
    ),
    Endpoint(
        topics.SIM_PAUSED, "std_msgs/msg/Bool", _SIM, (SOIL,), (MACHINE, OPERATOR, *_PAGES),
        "TRANSIENT_LOCAL", "on change",
        "whether simulated time stands still",
    ),
    Endpoint(
        topics.TF, "tf2_msgs/msg/TFMessage", _SIM, (MACHINE,), (), "STATE",
        "`transform_rate`, 20 Hz", "poses of links, cylinders, sprockets, idlers and view points",
        "tf2_msgs is installed and `publish_tf` is set; else bags have it, made by the recorder",
    ),
    Endpoint(
        topics.RECORDER_STATUS, _STRING, _SIM, (RECORDER,), (), "TRANSIENT_LOCAL",
        "1 Hz wall clock", "JSON: bag, messages, bytes, losses",
    ),
    Endpoint(
        topics.DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", _SIM,
        (SOIL, MACHINE, OPERATOR, RECORDER, *_PAGES), _PAGES, "STATE",
        "1 Hz wall clock, and when an emergency stop changes",
        "rates, late ticks, rejected input, imbalance, tilt, emergency stops and problems of each"
        " node",
    ),
)  # fmt: skip


def _service(name: str, kind: str, description: str) -> Endpoint:
    return Endpoint(
        name, f"std_srvs/srv/{kind}", _SIM, (SOIL,), (), "", "", description,
        kind=EndpointKind.SERVICE,
    )  # fmt: skip


_SERVICES = (
    _service(topics.PAUSE_SERVICE, "SetBool", "pause (true) or continue (false)"),
    _service(topics.STEP_SERVICE, "Trigger", "advance one tick while paused; returns when done"),
    _service(topics.RESET_SERVICE, "Trigger", "begin a new run on the initial terrain"),
    _service(
        topics.VERIFY_SERVICE, "Trigger", "recount all columns and compare with the running total"
    ),
    _service(topics.SAVE_SERVICE, "Trigger", "write the terrain to `save_path`"),
    _service(
        topics.RELEASE_SERVICE, "Trigger",
        "continue without silent machines and turn the soil they held into terrain",
    ),
)  # fmt: skip

INTERFACE: tuple[Endpoint, ...] = (
    *_COMMANDS,
    *_MACHINE_STATE,
    *_MACHINE_NODE,
    *_TERRAIN,
    *_EXCHANGE,
    *_SIMULATION,
    *_SERVICES,
)
"""All topics and services, in the order in which documents list them."""


def endpoints_of(executable: str) -> tuple[list[Endpoint], list[Endpoint], list[Endpoint]]:
    """Return the (subscribed topics, published topics, services) of an executable."""
    subscribed = [each for each in INTERFACE if executable in each.subscribers]
    own = [each for each in INTERFACE if executable in each.publishers]
    published = [each for each in own if each.kind is EndpointKind.TOPIC]
    return subscribed, published, [each for each in own if each.kind is EndpointKind.SERVICE]


_SHARED = (topics.SOIL_TOOL_SWEEPS, topics.SOIL_DEPOSIT_REQUESTS, topics.TF)
"""Topics that several nodes of the one executable publish together."""


@lru_cache(maxsize=1024)
def is_exclusive(topic: str) -> bool:
    """Return whether only one node may publish a topic.

    Args:
        topic: an absolute name; one that is not of this interface is not exclusive.
    """
    found = _topics_named(topic)
    return all(
        len(each.publishers) == 1 and ANY not in each.publishers and each.name not in _SHARED
        for each in found
    ) and bool(found)


@lru_cache(maxsize=1024)
def holds_state(topic: str) -> bool:
    """Return whether the newest message of a topic is what it is about, such as joint states.

    Args:
        topic: an absolute name.
    """
    return any(each.qos in ("STATE", "TRANSIENT_LOCAL") for each in _topics_named(topic))


def _topics_named(topic: str) -> list[Endpoint]:
    """Return the topics of the interface that an absolute name may denote."""
    return [
        each
        for each in INTERFACE
        if each.kind is EndpointKind.TOPIC
        and re.fullmatch(f".*/{re.sub('<[^>]*>', '[^/]+', each.name)}", topic)
    ]

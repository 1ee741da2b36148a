"""What format 1 of recordings named otherwise than format 2, the current one.

Each table maps an old name to its current name.
"""

from __future__ import annotations

import re

__all__ = [
    "ADDED_FIELDS",
    "CONFIG_KEYS",
    "DIAGNOSTICS_KEYS",
    "DROPPED_LABELS",
    "FIELDS",
    "JSON_KEYS",
    "MACHINE_KEYS",
    "NODES",
    "RANGES",
    "SOIL_KEYS",
    "TRACK_MODELS",
    "current_topic",
]

_GLOBAL_TOPICS = {
    "/soil/landed": "/soil/deposit_requests",
    "/soil/refusals": "/soil/join_rejections",
    "/terrain/changes": "/terrain/map_updates",
}
_MACHINE_TOPICS = {  # below a machine's namespace
    "soil_owed": "conversion_backlog",
    "encoders": "joint_states_measured",
}
_IMU_TOPIC = re.compile(r"/imu/[^/]+$")
_IMU_TYPE = "sensor_msgs/msg/Imu"

FIELDS = {
    "epoch": "run_id",
    "source": "machine_id",
    "life": "session_id",
    "holds": "reaction",
    "landed_received": "deposit_requests_received",
    "landed_durable": "deposit_requests_durable",
    "owed": "backlog",
    "previous": "previous_tick",
}
"""Fields of points, and labels of arrays after their last dot."""

ADDED_FIELDS: dict[str, tuple[tuple[str, str, str, float], ...]] = {
    "tool_sweeps": (
        ("room_mm3", "<u4", "pair", 2**32 - 1),
        ("work", "<f4", "run_id", 0.0),
        ("pressure", "<f4", "run_id", 0.0),
    ),
    "forces": (("work", "<f4", "run_id", 0.0),),
    "map_updates": (("rut_depth", "<f4", "run_id", 0.0),),
    "map": (("rut_depth", "<f4", "revision", 0.0),),
}
"""Fields that were added to rows, by the last part of their topic: name, type, the field that they
come before, and their value in older recordings."""

RANGES = {"landed": "deposit_requests", "changed": "map_updates"}
"""Labels of arrays before a dot."""

DROPPED_LABELS = frozenset({"conversions_durable", "deposit_requests_durable"})
"""Labels without a successor, by their renamed field."""

JSON_KEYS: dict[str, dict[str, str]] = {
    "phase": {"given_up": "abort_reason"},
    "cycles": {
        "passes": "num_passes",
        "planned": "planned_volume",
        "carried": "carried_fill",
        "delivered": "delivered_fill",
        "left": "residual_fill",
        "moved": "moved_volume",
    },
    "status": {"gaps": "num_lost"},
    "join_rejections": {"epoch": "run_id", "source": "machine_id", "life": "session_id"},
}
"""Keys of JSON objects, by the last part of their topic."""

MACHINE_KEYS = {
    "source": "machine_id",
    "await_commands_every": "command_wait_period",
    "await_listeners": "required_subscribers",
}
"""Parameters of a machine."""

CONFIG_KEYS: dict[str, dict[str, str]] = {
    "run": {"epoch": "run_id", "tick": "tick_period"},
    "soil_sim": {"tick": "tick_period", "await_listeners": "required_subscribers"},
    "site": {"points": "num_points", "lowest": "png_min_height", "highest": "png_max_height"},
    "soil": {
        "other_soils": "additional_soils",
        "slip_radius": "relaxation_radius",
        "slip_tolerance": "relaxation_tolerance",
        "slip_budget": "max_cell_visits_per_tick",
        "dig_depth": "soil_depth",
        "key_points_between": "num_interpolated_key_points",
        "angle_noise": "repose_angle_noise",
        "shape_noise": "redistribution_noise",
        "normal_noise": "surface_tilt_noise",
    },
    "machine_sim": MACHINE_KEYS,
    "stepping": {
        "tracks": "track_model",
        "release_per_tick": "max_releases_per_tick",
        "landings_per_tick": "max_deposit_requests_per_tick",
        "load_acts": "payload_coupling",
        "cutting_acts": "cutting_forces",
    },
    "particles": {
        "wall_restitution": "boundary_restitution",
        "ground_rolling": "ground_rolling_friction",
        "skin": "verlet_skin",
        "release_size": "release_radius_fraction",
        "sleeping": "allow_sleeping",
        "carried": "allow_load_locking",
        "wake_tilt": "wake_gravity_change",
    },
    "commands": {"stamp_lead": "max_stamp_lead", "unit_mistake": "unit_error_factor"},
}
"""Parameters, by section of a node's configuration."""

SOIL_KEYS = {
    "stick": "moisture_strength_factors",
    "spread": "size_spread",
    "bearing_cohesion": "bekker_k_c",
    "bearing_friction": "bekker_k_phi",
    "bearing_exponent": "bekker_n",
    "bearing": "moisture_bearing_factors",
    "shear_modulus": "janosi_k",
}
"""Parameters of each soil in the section `run` of a configuration."""

TRACK_MODELS = {"fast": "kinematic", "physics": "dynamic"}
"""Values of `track_model`."""

NODES = {"operator": "dig_operator", "recorder": "exchange_recorder"}
"""Names of nodes."""

DIAGNOSTICS_KEYS = {
    "soil_sim": {"epoch": "run_id", "schedule_slips": "reschedules"},
    "machine_sim": {"phase": "join_state"},
    "exchange_recorder": {"gaps": "num_lost"},
}
"""Keys of diagnostics, by the current name of their node."""


def current_topic(topic: str, type_name: str) -> str:
    """Return the current name of a recorded topic.

    Args:
        topic: the name in the bag.
        type_name: the message type, as `sensor_msgs/msg/Imu`.
    """
    if topic in _GLOBAL_TOPICS:
        return _GLOBAL_TOPICS[topic]
    if type_name == _IMU_TYPE and _IMU_TOPIC.search(topic):
        return f"{topic}/data"
    namespace, _, name = topic.rpartition("/")
    return f"{namespace}/{_MACHINE_TOPICS.get(name, name)}" if namespace else topic

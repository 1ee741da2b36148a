"""Units of the columns, by the names of fields and labels."""

from __future__ import annotations

__all__ = ["unit_of"]

_BY_FIELD = {
    ("sensor_msgs/msg/JointState", "position"): "rad or m",
    ("sensor_msgs/msg/JointState", "velocity"): "rad/s or m/s",
    ("sensor_msgs/msg/JointState", "effort"): "N m or N",
    ("geometry_msgs/msg/Point", ""): "m",
    ("geometry_msgs/msg/Quaternion", ""): "1",
    ("geometry_msgs/msg/Twist", "linear"): "m/s",
    ("geometry_msgs/msg/Twist", "angular"): "rad/s",
    ("geometry_msgs/msg/Wrench", "force"): "N",
    ("geometry_msgs/msg/Wrench", "torque"): "N m",
    ("geometry_msgs/msg/Transform", "translation"): "m",
    ("geometry_msgs/msg/Transform", "rotation"): "1",
    ("sensor_msgs/msg/Imu", "angular_velocity"): "rad/s",
    ("sensor_msgs/msg/Imu", "linear_acceleration"): "m/s^2",
    ("nav_msgs/msg/MapMetaData", "resolution"): "m",
}
"""Units by message type and field; an empty field is any of the type. Nested fields inherit it."""

_BY_NAME = {
    **dict.fromkeys(("x", "y", "z", "x0", "y0", "z0", "x1", "y1", "z1"), "m"),
    **dict.fromkeys(("vx", "vy", "vz"), "m/s"),
    **dict.fromkeys(("fx", "fy", "fz"), "N"),
    **dict.fromkeys(("tx", "ty", "tz"), "N m"),
    **dict.fromkeys(("diameter", "loose_depth", "elevation", "design_difference"), "m"),
    **dict.fromkeys(
        ("terrain", "in_flight", "pending", "particles", "absent", "outside", "start", "imbalance"),
        "mm^3",
    ),
    **dict.fromkeys(("planned_volume", "moved_volume", "hauled_volume"), "m^3"),
    **dict.fromkeys(("duration", "loading_time", "time", "start_time", "end_time"), "s"),
    **dict.fromkeys(("fill", "carried_fill", "delivered_fill", "residual_fill"), "1"),
    "moisture": "%",
    "work": "J",
    "max_force": "N",
    "stamp_sec": "s",
    "stamp_nanosec": "ns",
    "within_tolerance": "1",
}
"""Units of fields of clouds, labels of arrays and keys of JSON objects."""

_BY_SUFFIX = {
    "_mm3": "mm^3",
    "_m3": "m^3",
    "_kg": "kg",
    "_pa": "Pa",
    "_n_m": "N m",
    "_n": "N",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
    "_percent": "%",
}
"""Units by the end of a name, the longest first where one is the end of another."""


def unit_of(name: str, message_type: str = "") -> str:
    """Return the unit of a field, label or key; empty if it is not known.

    Args:
        name: its name.
        message_type: for a field of a message, its type.
    """
    if message_type:
        return _BY_FIELD.get((message_type, name)) or _BY_FIELD.get((message_type, "")) or ""
    last = name.rpartition(".")[2]
    if last in _BY_NAME:
        return _BY_NAME[last]
    return next((unit for suffix, unit in _BY_SUFFIX.items() if last.endswith(suffix)), "")

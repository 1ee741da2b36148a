"""Names of the topics between soil and machines; those of one machine lie in its namespace."""

from __future__ import annotations

from msg_bridge.contract.messages import Stream

__all__ = [
    "CONVERSION_BACKLOG_TOPIC",
    "CUT_FILL_TOPIC",
    "JOIN_REJECTIONS_TOPIC",
    "MACHINE_HEADER_TOPIC",
    "MAP_FRAME",
    "SOIL_HEADER_TOPIC",
    "STREAM_TOPICS",
    "SURFACE_TILT_TOPIC",
    "TERRAIN_MAP_TOPIC",
    "machine_namespace_of",
]

MAP_FRAME = "map"

STREAM_TOPICS: dict[Stream, str] = {
    Stream.SWEEP: "/soil/tool_sweeps",
    Stream.DEPOSIT_REQUEST: "/soil/deposit_requests",
    Stream.CONVERSION: "/soil/conversions",
    Stream.MAP_UPDATE: "/terrain/map_updates",
    Stream.FORCE: "/soil/forces",
}
"""Topic of each stream of rows that all share."""

TERRAIN_MAP_TOPIC = "/terrain/map"
CUT_FILL_TOPIC = "/soil/cut_fill"
SURFACE_TILT_TOPIC = "/terrain/surface_tilt"
"""What is still to dig and to fill; only where there is a design."""

SOIL_HEADER_TOPIC = "/soil/tick"
"""The soil's headers, and its requests to machines."""

JOIN_REJECTIONS_TOPIC = "/soil/join_rejections"
MACHINE_HEADER_TOPIC = "soil_tick"
"""A machine's headers, and its requests to the soil; in its namespace."""

CONVERSION_BACKLOG_TOPIC = "conversion_backlog"
"""Rows that a machine that came back is owed; in its namespace."""


def machine_namespace_of(topic: str) -> str | None:
    """The machine's namespace of a `.../soil_tick` topic, None for any other."""
    namespace, _, name = topic.rpartition("/")
    return namespace if name == MACHINE_HEADER_TOPIC and namespace else None

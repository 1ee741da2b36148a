"""Names of the topics between soil and machines; those of one machine lie in its namespace."""

from __future__ import annotations

from msg_bridge.contract.messages import Stream

__all__ = [
    "CUT_FILL_TOPIC",
    "MAP_FRAME",
    "MAP_TOPIC",
    "OWED_TOPIC",
    "REFUSALS_TOPIC",
    "SOIL_TICK_TOPIC",
    "STREAM_TOPIC",
    "TICK_TOPIC",
    "TILT_TOPIC",
    "namespace_of",
]

MAP_FRAME = "map"

STREAM_TOPIC: dict[Stream, str] = {
    Stream.SWEEP: "/soil/tool_sweeps",
    Stream.LANDED: "/soil/landed",
    Stream.CONVERSION: "/soil/conversions",
    Stream.CHANGED: "/terrain/changes",
    Stream.FORCE: "/soil/forces",
}
"""Topic of each stream of rows that all share."""

MAP_TOPIC = "/terrain/map"
CUT_FILL_TOPIC = "/soil/cut_fill"
TILT_TOPIC = "/terrain/surface_tilt"
"""What is still to dig and to fill; only where there is a design."""

TICK_TOPIC = "/soil/tick"
"""The soil's headers, and its requests to machines."""

REFUSALS_TOPIC = "/soil/refusals"
SOIL_TICK_TOPIC = "soil_tick"
"""A machine's headers, and its requests to the soil; in its namespace."""

OWED_TOPIC = "soil_owed"
"""Rows that a machine that came back is owed; in its namespace."""


def namespace_of(topic: str) -> str | None:
    """The machine's namespace of a `.../soil_tick` topic, None for any other."""
    namespace, _, name = topic.rpartition("/")
    return namespace if name == SOIL_TICK_TOPIC and namespace else None

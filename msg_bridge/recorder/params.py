"""Parameters of the recorder: what is recorded, and where."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from msg_bridge.bag.writer import CHUNK_SIZE, COMPRESSIONS
from msg_bridge.contract import topics
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.raw_topics.topic_selection import is_topic_selected, validate_expression

__all__ = ["RecorderParams"]


@dataclass(frozen=True)
class RecorderParams(Parameters):
    """Parameters of `exchange_recorder`."""

    path: str = parameter("", "folder to create; by default bags/ and the time (UTC)")
    include: str = parameter(
        "", "regular expression: record only topics whose names match; by default all"
    )
    exclude: str = parameter(
        "", "regular expression: do not record topics whose names match; by default none"
    )
    compression: str = parameter("zstd", "compression of the chunks", choices=tuple(COMPRESSIONS))
    chunk_size: int = parameter(
        CHUNK_SIZE, "size of a chunk before compression", unit="bytes", low=1024, high=1 << 30
    )
    repeat_transient_local_period: float = parameter(
        5.0,
        "period at which the newest message of a transient-local topic is written again; 0: never",
        unit="s",
        low=0.0,
        high=1e6,
    )
    terrain_keyframe_period: float = parameter(
        20.0,
        "period at which a terrain map is written in full; in between, as its difference from that"
        " one; 0: each in full",
        unit="s",
        low=0.0,
        high=1e6,
    )
    max_bagfile_size: int = parameter(
        0,
        "size of a file from which on another one is begun; 0: one file",
        unit="bytes",
        low=0,
        high=1 << 50,
    )
    max_bagfile_duration: float = parameter(
        0.0,
        "log time after which another file is begun; 0: one file",
        unit="s",
        low=0.0,
        high=1e9,
    )
    flush_period: float = parameter(
        1.0,
        "wall time after which what was received is in the file, so that a killed recorder leaves"
        " it there",
        unit="s",
        low=0.05,
        high=3600.0,
    )
    max_queue_size: int = parameter(
        1 << 28,
        "size of the messages that wait for a slow disk, above which messages are dropped and"
        " counted as lost",
        unit="bytes",
        low=1 << 20,
        high=1 << 40,
    )
    make_tf: bool = parameter(
        True,
        "record /tf made from <m>/transforms where no node publishes it, as without tf2_msgs",
    )
    grid_map_period: float = parameter(
        10.0,
        "minimum simulation time between messages of /terrain/grid_map, recorded where no node"
        " publishes it, as without grid_map_msgs; 0: never",
        unit="s",
        low=0.0,
        high=1e6,
    )
    scan_period: float = parameter(
        0.1, "wall time between searches for new topics", unit="s", low=0.01, high=10.0
    )
    niceness: int = parameter(
        10,
        "niceness of the process, so that recording delays no tick",
        low=0,
        high=19,
    )
    progress: bool = parameter(
        True, "print progress: one updated line on a terminal, else a log line every 5 s"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_expression("include", self.include)
        validate_expression("exclude", self.exclude)

    @property
    def folder(self) -> Path:
        """Folder of the bag; without `path` it is named by the current time."""
        if self.path:
            return Path(self.path).expanduser()
        return Path("bags", datetime.now(timezone.utc).strftime("%Y-%m-%dT%H-%M-%SZ"))

    def is_selected(self, topic: str) -> bool:
        """Return whether a topic is recorded; views of the terrain only if `include` names them."""
        if not self.include and topic.endswith(f"/{topics.TERRAIN_VIEW}"):
            return False
        return is_topic_selected(topic, self.include, self.exclude)

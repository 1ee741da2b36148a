"""Parameters of the recorder: what is recorded, and where."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from msg_bridge.bag.writer import CHUNK_SIZE, COMPRESSIONS
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

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
        _validate_regex("include", self.include)
        _validate_regex("exclude", self.exclude)

    @property
    def folder(self) -> Path:
        """Folder of the bag; without `path` it is named by the current time."""
        if self.path:
            return Path(self.path).expanduser()
        return Path("bags", datetime.now(timezone.utc).strftime("%Y-%m-%dT%H-%M-%SZ"))

    def is_selected(self, topic: str) -> bool:
        """Return whether a topic is recorded."""
        if self.exclude and re.search(self.exclude, topic):
            return False
        return re.search(self.include, topic) is not None


def _validate_regex(name: str, text: str) -> None:
    try:
        re.compile(text)
    except re.error as error:
        raise ParameterError(
            f"{name} is {text!r}, which is not a regular expression: {error}"
        ) from error

"""Parameters of the recorder."""

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
    """What is recorded, where and how."""

    path: str = parameter("", "folder to write; by default bags/ and the time (UTC)")
    include: str = parameter(
        "", "regular expression: only topics in whose name it is found; by default all"
    )
    exclude: str = parameter(
        "", "regular expression: no topic in whose name it is found; by default none"
    )
    compression: str = parameter("zstd", "of the chunks", choices=tuple(COMPRESSIONS))
    chunk_size: int = parameter(
        CHUNK_SIZE, "of a chunk before compression", unit="bytes", low=1024, high=1 << 30
    )
    repeat_transient_local_period: float = parameter(
        5.0,
        "time after which the newest of a latched topic is written again, 0 for never",
        unit="s",
        low=0.0,
        high=1e6,
    )
    scan_period: float = parameter(
        0.1, "wall time between two looks for new topics", unit="s", low=0.01, high=10.0
    )
    niceness: int = parameter(
        10,
        "by how much it yields to other processes: who records must not make a tick late",
        low=0,
        high=19,
    )
    progress: bool = parameter(
        True, "tell on the terminal how it goes: a line rewritten there, else one every 5 s"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _validate_regex("include", self.include)
        _validate_regex("exclude", self.exclude)

    @property
    def folder(self) -> Path:
        """Where to record; another one at every moment if `path` is not given."""
        if self.path:
            return Path(self.path).expanduser()
        return Path("bags", datetime.now(timezone.utc).strftime("%Y-%m-%dT%H-%M-%SZ"))

    def is_selected(self, topic: str) -> bool:
        """Whether a topic is to be recorded."""
        if self.exclude and re.search(self.exclude, topic):
            return False
        return re.search(self.include, topic) is not None


def _validate_regex(name: str, text: str) -> None:
    try:
        re.compile(text)
    except re.error as error:
        raise ParameterError(
            f"{name} is {text!r}, which is no regular expression: {error}"
        ) from error

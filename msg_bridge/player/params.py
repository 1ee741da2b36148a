"""Parameters of the player: what is played, and how."""

from __future__ import annotations

import re
from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.raw_topics.topic_selection import is_topic_selected, validate_expression

__all__ = ["CLOCK_MODES", "MAX_RATE", "MIN_RATE", "PlayerParams"]

CLOCK_MODES = ("auto", "log", "none")
"""auto: the recorded /clock, or log times if the bag has none; log: log times; none."""

MIN_RATE, MAX_RATE = 0.01, 1000.0

_NAMESPACE = re.compile(r"/*|/*[a-z_]\w*(/[a-z_]\w*)*/*", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class PlayerParams(Parameters):
    """Parameters of the player."""

    rate: float = parameter(1.0, "seconds of the recording per second", low=MIN_RATE, high=MAX_RATE)
    start: float = parameter(0.0, "begin at this time", unit="s", low=0.0, high=1e9)
    end: float = parameter(
        0.0, "end at this time; 0: at the end of the bag", unit="s", low=0.0, high=1e9
    )
    loop: bool = parameter(False, "begin again at the end")
    paused: bool = parameter(False, "begin paused, after the keyframes")
    include: str = parameter("", "regular expression: play only topics whose names match")
    exclude: str = parameter("", "regular expression: do not play topics whose names match")
    prefix: str = parameter("", "namespace put before the names of all topics")
    clock: str = parameter("auto", "source of /clock", choices=CLOCK_MODES)

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_expression("include", self.include)
        validate_expression("exclude", self.exclude)
        if not _NAMESPACE.fullmatch(self.prefix):
            raise ParameterError(
                f"prefix is {self.prefix!r}; give a namespace such as /recorded: names of letters,"
                " digits and _ that do not begin with a digit"
            )
        if self.end and self.end <= self.start:
            raise ParameterError(
                f"end is {self.end:g} s; give a time after start, {self.start:g} s"
            )

    def is_selected(self, topic: str) -> bool:
        """Return whether a topic is played."""
        return is_topic_selected(topic, self.include, self.exclude)

    def published_name(self, topic: str) -> str:
        """Return the name under which a topic is published."""
        prefix = self.prefix.strip("/")
        return f"/{prefix}{topic}" if prefix else topic

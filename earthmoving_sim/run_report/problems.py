"""Problems that nodes reported in `/diagnostics`, one entry for each condition."""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["Problem", "Problems"]

_MEASURED = re.compile(r"(?<![\w/.])(?<!machine )(?<!machine_id )[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
"""A number that is neither part of a name nor the id of a machine."""


@dataclass
class Problem:
    """A problem of a node; its reports may differ in the numbers that they give.

    Attributes:
        source: name of the node.
        level: 1 warning, 2 error, 3 stale; the highest of the reports.
        text: the last message of that level.
        num_reports: number of reports.
        first, last: times of the first and last report [s from the first message].
    """

    source: str
    level: int
    text: str
    num_reports: int
    first: float
    last: float


class Problems:
    """The problems of all nodes.

    Messages do not name their condition. Those of one condition have the same words and other
    numbers, such as the present real-time factor.
    """

    def __init__(self) -> None:
        self._problems: dict[tuple[str, str], Problem] = {}  # by node and words of the message

    def add(self, source: str, level: int, text: str, time: float) -> None:
        """Add a report; arguments as in `Problem`."""
        key = source, _MEASURED.sub("#", text)
        problem = self._problems.get(key)
        if problem is None:
            self._problems[key] = Problem(source, level, text, 1, time, time)
            return
        if level >= problem.level:
            problem.level, problem.text = level, text
        problem.num_reports += 1
        problem.last = time

    def by_severity(self) -> list[Problem]:
        """Return all, the highest level first, and of one level the most frequent."""
        return sorted(self._problems.values(), key=lambda each: (-each.level, -each.num_reports))

"""CheckResult: outcome of one check, with advice."""

from __future__ import annotations

import enum
from dataclasses import dataclass

__all__ = ["CheckResult", "Status"]


class Status(enum.Enum):
    """Outcome of one check; the value is the sign printed before it."""

    OK = "✓"
    WARNING = "!"
    MISSING = "✗"


@dataclass(frozen=True)
class CheckResult:
    """Result of one check.

    Attributes:
        name: name of what was checked.
        status: outcome.
        detail: version, place or size that was found.
        advice: what to do, unless the status is OK.
    """

    name: str
    status: Status
    detail: str
    advice: str = ""

    def __str__(self) -> str:
        line = f"{self.status.value} {self.name:<14} {self.detail}"
        return f"{line}\n  → {self.advice}" if self.advice else line

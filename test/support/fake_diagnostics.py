"""FakeDiagnostics: keeps what a node's diagnostics are given, in place of `Diagnostics`."""

from __future__ import annotations

from collections.abc import Callable

from msg_bridge.nodes.diagnostics import Level

__all__ = ["FakeDiagnostics"]


class FakeDiagnostics:
    """Values and problems that were set last.

    Attributes:
        values: value of each key.
        problems: text and level of each condition.
        update: the task that was added last.
    """

    def __init__(self) -> None:
        self.values: dict[str, object] = {}
        self.problems: dict[str, tuple[str, Level]] = {}
        self.update: Callable[[], object] = lambda: None

    def add_task(self, task: Callable[[], object]) -> None:
        """Keep a task."""
        self.update = task

    def set(self, key: str, value: object) -> None:
        """Keep a value."""
        self.values[key] = value

    def problem(
        self, text: str, level: Level = Level.WARN, *, condition: str = "", **_: object
    ) -> None:
        """Keep a problem; its order among others does not count."""
        self.problems[condition] = (text, level)

    def clear(self, condition: str = "") -> None:
        """Remove a problem."""
        self.problems.pop(condition, None)

"""MembershipLog: logs which machines join and leave the run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

__all__ = ["MembershipLog"]


class MembershipLog:
    """Logs a line for each machine that joins or leaves."""

    def __init__(self, log: Callable[[str], object], namespaces: Mapping[int, str]) -> None:
        """
        Args:
            log: logs a line.
            namespaces: namespace of each known machine node, by machine id.
        """
        self._log, self._namespaces = log, namespaces
        self._joined: set[int] = set()

    def start_run(self) -> None:
        """Begin a run, which has no machines."""
        self._joined.clear()

    def remove(self, machine_id: int) -> None:
        """Remove a machine without a line: its end has been logged."""
        self._joined.discard(machine_id)

    def update(self, joined: Iterable[int], tick: int) -> None:
        """Log the changes since the last call.

        Args:
            joined: ids of the machines in the run.
            tick: the last tick.
        """
        now = set(joined)
        for machine_id in sorted(now - self._joined):
            self._log(f"{self._name(machine_id)} joined in tick {tick}")
        for machine_id in sorted(self._joined - now):
            self._log(f"{self._name(machine_id)} left in tick {tick}")
        self._joined = now

    def _name(self, machine_id: int) -> str:
        return f"{self._namespaces.get(machine_id, 'a machine')} (machine_id {machine_id})"

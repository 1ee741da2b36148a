"""MembershipLog: reports machines that join, leave, are dropped, or come back without soil."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from soil_sim.node.soil_run import SilentMachine

__all__ = ["MembershipLog"]

_DROPPED = "dropped machines"
_MM3_PER_M3 = 10**9


class Logger(Protocol):
    """The part of a node's logger that is used here."""

    def info(self, message: str) -> object: ...
    def warning(self, message: str) -> object: ...


class DiagnosticsValues(Protocol):
    """The part of the diagnostics of a node that is used here."""

    def set(self, key: str, value: Any) -> None: ...
    def count(self, key: str) -> None: ...
    def problem(self, text: str, *, condition: str) -> None: ...
    def clear(self, condition: str) -> None: ...


class MembershipLog:
    """Logs a line for each change, and keeps what needs attention in the diagnostics."""

    def __init__(
        self, logger: Logger, diagnostics: DiagnosticsValues, namespaces: Mapping[int, str]
    ) -> None:
        """
        Args:
            logger: logger of the node.
            diagnostics: diagnostics of the node.
            namespaces: namespace of each known machine node, by machine id.
        """
        self._logger, self._diagnostics, self._namespaces = logger, diagnostics, namespaces
        self.start_run()

    def start_run(
        self, joined: Iterable[int] = (), ended_volumes: Mapping[int, int] | None = None
    ) -> None:
        """Begin a run.

        Args:
            joined, ended_volumes: as for `update`; a new run has no machines.
        """
        self._joined = set(joined)
        self._ended_volumes = dict(ended_volumes or {})
        self._dropped: dict[int, str] = {}
        self._report()

    def drop(self, silent: SilentMachine, tick: int) -> None:
        """Report a machine without which the run continues; it is a problem until it rejoins.

        Args:
            silent: the machine.
            tick: the last tick.
        """
        name = self._name(silent.machine_id)
        self._logger.warning(
            f"{name} silent for {silent.duration:.1f} s: the run continues without it; its soil is"
            " booked as absent, until it rejoins with that soil (a restarted node does so with"
            " recovery.path, and else joins without soil)"
        )
        self._diagnostics.count("machines_dropped")
        self._joined.discard(silent.machine_id)
        self._dropped[silent.machine_id] = f"{name} was silent and is dropped since tick {tick}"
        self._report()

    def release(self) -> None:
        """End the reports on dropped machines: their soil was released."""
        self._dropped.clear()
        self._report()

    def update(self, joined: Iterable[int], tick: int, ended_volumes: Mapping[int, int]) -> None:
        """Log the changes since the last call.

        Args:
            joined: ids of the machines in the run.
            tick: the last tick.
            ended_volumes: soil in the ended accounts of joined machines [mm^3], by machine id.
        """
        now = set(joined)
        if now == self._joined and ended_volumes == self._ended_volumes:
            return
        for machine_id in sorted(now - self._joined):
            self._logger.info(f"{self._name(machine_id)} joined in tick {tick}")
            self._dropped.pop(machine_id, None)
        for machine_id in sorted(self._joined - now):
            self._logger.info(f"{self._name(machine_id)} left in tick {tick}")
        for machine_id, volume in ended_volumes.items():
            if volume > self._ended_volumes.get(machine_id, 0):
                self._logger.warning(
                    f"{self._name(machine_id)} joined in tick {tick} without the soil of its"
                    f" earlier session: {volume / _MM3_PER_M3:.3f} m3 are booked as absent;"
                    " /soil/release turns them into terrain"
                )
        self._joined, self._ended_volumes = now, dict(ended_volumes)
        self._report()

    def _report(self) -> None:
        """Set problem and values in the diagnostics."""
        if self._dropped:
            self._diagnostics.problem("; ".join(self._dropped.values()), condition=_DROPPED)
        else:
            self._diagnostics.clear(_DROPPED)
        left = [
            f"{v / _MM3_PER_M3:.3f} m3 of {self._name(n)}" for n, v in self._ended_volumes.items()
        ]
        self._diagnostics.set("soil_of_ended_sessions", ", ".join(left) or "none")

    def _name(self, machine_id: int) -> str:
        return f"{self._namespaces.get(machine_id, 'a machine')} (machine_id {machine_id})"

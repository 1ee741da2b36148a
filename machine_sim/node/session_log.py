"""SessionLog: reports the sessions of a machine node, and with which state the first one begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_run import MachineRun
from msg_bridge.nodes.diagnostics import Diagnostics

__all__ = ["SessionLog"]


class Logger(Protocol):
    """The part of a node's logger that is used here."""

    def info(self, message: str) -> Any: ...
    def warning(self, message: str) -> Any: ...


class SessionLog:
    """Log lines and diagnostics on the sessions of a node."""

    def __init__(
        self,
        logger: Logger,
        diagnostics: Diagnostics,
        machine_id: int,
        instances: Sequence[MachineInstance],
    ) -> None:
        """
        Args:
            logger: logger of the node.
            diagnostics: its diagnostics.
            machine_id: its id in the exchange.
            instances: its machines.
        """
        self._logger, self._diagnostics = logger, diagnostics
        self._machine_id, self._instances = machine_id, tuple(instances)

    def log_joined(self, run: MachineRun, *, is_first: bool) -> None:
        """Log that a session has begun.

        The first session of a process begins with the initial state: the node saves none. If the
        run is in progress, an earlier process of this machine id may have held soil.

        Args:
            run: the run that the node has joined.
            is_first: whether it is the first session of this process in the run.
        """
        text = f"joined run {run.facts.run_id} in tick {run.tick}"
        if not is_first:
            self._logger.info(text)
            return
        start = "; ".join(_describe_start(each) for each in self._instances)
        self._diagnostics.set("session_start", f"tick {run.tick}, no saved state: {start}")
        if run.tick == 0:
            self._logger.info(text)
            return
        self._logger.warning(
            f"{text}, while it was in progress, without a saved state: the node starts with"
            f" {start}; soil that an earlier session of machine_id {self._machine_id} held is"
            " booked as absent (soil_of_ended_sessions in the diagnostics of the soil node)"
        )


def _describe_start(instance: MachineInstance) -> str:
    """Describe the initial state of a machine."""
    (x, y), yaw = instance.placement.position, instance.params.yaw
    name = instance.name or instance.spec.name
    return f"{name} at x {x:g} m, y {y:g} m, yaw {yaw:g} deg, with empty tools"

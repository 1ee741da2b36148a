"""Crash recovery of a node: the journal of its parameters, its log, its diagnostics, its end."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Protocol

from rclpy.node import Node

from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.ros_parameters import reject_unknown_overrides
from msg_bridge.recovery.errors import RecoveryError
from msg_bridge.recovery.params import RecoveryParams
from msg_bridge.recovery.run_journal import RunJournal, SavedRun

__all__ = ["NodeRecovery"]

_CONDITION = "recovery"
"""Name of the problem of a run that cannot be recovered."""

_DISCOVERY_TIME = 1.0
"""Wall time from a restart in which subscribers are discovered [s]; what is published before would
be lost."""


class Logger(Protocol):
    """The part of a node's logger that is used here."""

    def info(self, message: str) -> object: ...
    def warning(self, message: str) -> object: ...
    def error(self, message: str) -> object: ...


class NodeRecovery:
    """Crash recovery of one node.

    Attributes:
        journal: the journal; None without recovery.
        found: the run that a process before did not end, continued or not; None without one.
    """

    def __init__(
        self,
        params: RecoveryParams,
        node_name: str,
        logger: Logger,
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            params: parameters of the recovery.
            node_name: fully qualified name of the node.
            logger: its logger.
            now: a monotonic wall clock [s].

        Raises:
            RecoveryError: the folder cannot be used.
        """
        self.found: SavedRun | None = None
        self._params, self._logger, self._now = params, logger, now
        self._settled_at = now()
        folder = params.folder(node_name)
        self._folder = folder
        self.journal = None if folder is None else RunJournal(folder, params.checkpoint_period)
        self._logged_problem = ""

    @classmethod
    def of_node(cls, params: RecoveryParams, node: Node) -> NodeRecovery:
        """Return the recovery of a ROS node that has declared its parameters.

        Raises:
            ParameterError: an unknown parameter was given: a node that is going to end for it must
                not begin a run, which would replace the saved one.
            RecoveryError: the folder cannot be used.
        """
        reject_unknown_overrides(node)
        return cls(params, node.get_fully_qualified_name(), node.get_logger())

    def saved_run(self) -> SavedRun | None:
        """Return the run to continue; None without one, or if a new one is wanted."""
        if self.journal is None:
            return None
        try:
            saved = self.journal.saved_run()
        except RecoveryError as error:
            if self._params.resume:
                self.reject(str(error))
            return None
        self.found = saved
        if saved is None:
            return None
        if not self._params.resume:
            self._logger.info(f"the run in {self._folder} is not continued: recovery.resume is off")
            return None
        for reason in saved.rejected:
            self._logger.warning(f"{self._folder}: {reason}; the state before it is used")
        return saved

    def warn(self, reason: str) -> None:
        """Report why ticks are not computed again."""
        self._logger.warning(f"{self._folder}: {reason}")

    def reject(self, reason: str) -> None:
        """Report that the saved run is not continued."""
        self._logger.error(
            f"the run in {self._folder} cannot be continued: {reason}; a new run begins"
        )

    def resume(self, saved: SavedRun, what: str) -> None:
        """Continue the journal of a run that was restored, and report it.

        Args:
            saved: the run.
            what: the run and its tick, for the log.
        """
        assert self.journal is not None, "there is a saved run"
        self.journal.resume(saved)
        self._settled_at = self._now() + _DISCOVERY_TIME
        origin = "a checkpoint" if saved.number else "its begin"
        self._logger.warning(
            f"{what} is continued after a crash: restored from {origin} and the"
            f" {saved.num_records} inputs after it"
        )

    @property
    def is_settling(self) -> bool:
        """Whether subscribers may not have been discovered yet after a restart."""
        return self._now() < self._settled_at

    def report_to(self, diagnostics: Diagnostics) -> None:
        """Report to the diagnostics of the node from now on."""
        if self.journal is not None:
            diagnostics.add_task(partial(self._report, diagnostics, self.journal))

    def _report(self, diagnostics: Diagnostics, journal: RunJournal) -> None:
        """Set the diagnostics, and log a problem when it begins and ends."""
        problem = journal.problem
        diagnostics.set("recovery_inputs", journal.number)
        diagnostics.set("recovery_checkpoints", journal.num_checkpoints)
        if problem:
            diagnostics.problem(problem, Level.ERROR, condition=_CONDITION)
        else:
            diagnostics.clear(_CONDITION)
        if problem and not self._logged_problem:
            self._logger.error(problem)
        elif self._logged_problem and not problem:
            self._logger.info("the run is journalled again: a restarted node can continue it")
        self._logged_problem = problem

    def end(self) -> None:
        """End the run, unless an exception ends the node: then a restarted one continues it."""
        if self.journal is not None and sys.exc_info()[0] is None:
            self.journal.end()

    def close(self) -> None:
        """Let other processes use the folder."""
        if self.journal is not None:
            self.journal.close()

"""ImbalanceReport: soil that was lost or created, in log, diagnostics and exit code."""

from __future__ import annotations

from typing import Any, Protocol

from msg_bridge.contract.ledger import Ledger
from msg_bridge.nodes.diagnostics import Diagnostics, Level

__all__ = ["EXIT_IMBALANCE", "ImbalanceReport"]

EXIT_IMBALANCE = 3
"""Exit code of a soil node after a run whose ledger was not balanced at every tick."""

_CONDITION = "imbalance"


class Logger(Protocol):
    """The part of a node's logger that is used here."""

    def error(self, message: str) -> Any: ...


class ImbalanceReport:
    """Reports the first imbalance of a run, and keeps it in the diagnostics until the run ends.

    Attributes:
        has_occurred: whether the ledger of any tick of any run was not balanced.
    """

    def __init__(self, logger: Logger, diagnostics: Diagnostics) -> None:
        """
        Args:
            logger: logger of the node.
            diagnostics: diagnostics of the node.
        """
        self._logger, self._diagnostics = logger, diagnostics
        self.has_occurred = False
        self._first: Ledger | None = None
        self._last_imbalance = 0

    def start_run(self) -> None:
        """Begin a run, which is balanced."""
        self._first, self._last_imbalance = None, 0
        self._diagnostics.clear(_CONDITION)

    def check(self, ledger: Ledger) -> None:
        """Report an imbalance in the ledger of a tick."""
        if ledger.imbalance == self._last_imbalance:
            return
        self._last_imbalance = ledger.imbalance
        self.has_occurred = True
        if self._first is None:
            self._first = ledger
            self._logger.error(f"{_describe(ledger)}: {_accounts(ledger)}")
        text = f"{_describe(ledger)}, first {_describe(self._first)}"
        self._diagnostics.problem(text, Level.ERROR, condition=_CONDITION)


def _describe(ledger: Ledger) -> str:
    return f"imbalance of {ledger.imbalance} mm3 at tick {ledger.tick}"


def _accounts(ledger: Ledger) -> str:
    """Return every account of a ledger [mm^3]."""
    names = ("terrain", "in_flight", "pending", "particles", "absent", "outside", "start")
    return ", ".join(f"{name} {getattr(ledger, name)}" for name in names)

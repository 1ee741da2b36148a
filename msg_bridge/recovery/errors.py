"""Errors of crash recovery."""

from __future__ import annotations

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["ChangedParametersError", "DivergenceError", "RecoveryError"]


class RecoveryError(EarthmovingError):
    """A run cannot be continued, or the folder of its journal cannot be used."""


class ChangedParametersError(RecoveryError):
    """A saved run was begun with other parameters; it is kept."""

    def __init__(self, difference: str) -> None:
        """
        Args:
            difference: the first parameter that differs.
        """
        super().__init__(
            f"the saved run was begun with other parameters ({difference}); start the node with"
            " those, or with recovery.resume:=false to begin a new run instead"
        )


class DivergenceError(RecoveryError):
    """Ticks that are computed again have other results than before."""

    def __init__(self, tick: int, reason: str = "its results are others") -> None:
        """
        Args:
            tick: the first such tick.
            reason: what differs.
        """
        super().__init__(
            f"tick {tick} cannot be computed again as before the crash ({reason}); was the run"
            " computed on another processor?"
        )

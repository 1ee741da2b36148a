"""Error of crash recovery."""

from __future__ import annotations

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["RecoveryError"]


class RecoveryError(EarthmovingError):
    """A run cannot be continued, or the folder of its journal cannot be used."""

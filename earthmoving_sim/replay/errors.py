"""Errors of replays."""

from __future__ import annotations

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["RecordedFileError", "ReplayError"]


class ReplayError(EarthmovingError):
    """A bag lacks what a replay needs."""


class RecordedFileError(EarthmovingError):
    """A file that a run depends on is neither in its bag nor on this computer."""

"""Errors of pictures and films."""

from __future__ import annotations

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["RenderError"]


class RenderError(EarthmovingError):
    """A picture cannot be made; the message states what to change."""

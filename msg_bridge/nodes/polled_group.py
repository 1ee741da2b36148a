"""Subscriptions that nobody waits for: what arrives is taken when the node looks."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup

__all__ = ["PolledGroup"]


class PolledGroup(CallbackGroup):
    """A group whose subscriptions wake no executor; take their messages from their handles."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never begun."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Never begun."""

"""Callback group of subscriptions that are polled, so that they do not wake the executor."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup

__all__ = ["PolledGroup"]


class PolledGroup(CallbackGroup):
    """Group that no executor runs; take the messages of its subscriptions from their handles."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: polled subscriptions are never executed."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""

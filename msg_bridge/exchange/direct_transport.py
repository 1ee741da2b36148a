"""The direct transport: messages are passed by calls within one process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from msg_bridge.contract.messages import Message

__all__ = ["DirectTransport", "Endpoint"]


class Endpoint(Protocol):
    """Anything that receives and sends messages: an exchange, or a component with one."""

    def receive(self, message: Message) -> object:
        """Process one message."""

    def drain_outbox(self) -> list[Message]:
        """Return the messages to send, and empty the outbox."""


class DirectTransport:
    """Delivers every message at once and in order."""

    def __init__(self, soil: Endpoint, machines: Sequence[Endpoint]) -> None:
        self._soil = soil
        self._machines = machines

    def deliver(self) -> int:
        """Deliver all messages in the outboxes: those of the machines first, then the soil's.

        Returns:
            The number of messages delivered.
        """
        num_delivered = 0
        for machine in self._machines:
            for message in machine.drain_outbox():
                self._soil.receive(message)
                num_delivered += 1
        for message in self._soil.drain_outbox():
            for machine in self._machines:
                machine.receive(message)
            num_delivered += 1
        return num_delivered

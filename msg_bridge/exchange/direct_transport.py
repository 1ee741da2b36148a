"""The direct transport: the same messages, handed over in the same process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from msg_bridge.contract.messages import Message

__all__ = ["DirectTransport", "Endpoint"]


class Endpoint(Protocol):
    """Anything that takes messages and has messages to give: an exchange, or a side around one."""

    def receive(self, message: Message) -> None:
        """Take one message."""

    def drain_outbox(self) -> list[Message]:
        """Give all that are waiting."""


class DirectTransport:
    """Carries every message at once, in order, none lost."""

    def __init__(self, soil: Endpoint, machines: Sequence[Endpoint]) -> None:
        self._soil = soil
        self._machines = machines

    def deliver(self) -> int:
        """Hand over all messages waiting on either side.

        Returns:
            How many were carried.
        """
        carried = 0
        for machine in self._machines:
            for message in machine.drain_outbox():
                self._soil.receive(message)
                carried += 1
        for message in self._soil.drain_outbox():
            for machine in self._machines:
                machine.receive(message)
            carried += 1
        return carried

"""The direct transport: the same messages, handed over in the same process."""

from __future__ import annotations

from collections.abc import Sequence

from msg_bridge.exchange.machine_side import MachineExchange
from msg_bridge.exchange.soil_side import SoilExchange

__all__ = ["DirectTransport"]


class DirectTransport:
    """Carries every message at once, in order, none lost."""

    def __init__(self, soil: SoilExchange, machines: Sequence[MachineExchange]) -> None:
        self._soil = soil
        self._machines = machines

    def carry(self) -> int:
        """Hand over all messages waiting on either side.

        Returns:
            How many were carried.
        """
        carried = 0
        for machine in self._machines:
            for message in machine.take_outbox():
                self._soil.receive(message)
                carried += 1
        for message in self._soil.take_outbox():
            for machine in self._machines:
                machine.receive(message)
            carried += 1
        return carried

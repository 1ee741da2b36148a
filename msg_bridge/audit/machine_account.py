"""The soil of one machine, by its headers and its conversion rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.contract.messages import MachineHeader
from msg_bridge.contract.rows import ConversionKind

__all__ = ["MachineAccount"]


class MachineAccount:
    """Account of one machine: the soil in its last header, and its conversions.

    Attributes:
        present: whether it takes part.
        pending, particles: soil in its last header [mm^3].
        received: number of the last conversion row included in that soil.
        lost_with_session: soil of its former sessions that it cannot bring back [mm^3].
    """

    def __init__(
        self, machine_id: int, conversions: NumberedRows, released: NDArray[np.bool_]
    ) -> None:
        """Begin with an empty machine.

        Args:
            machine_id: the machine.
            conversions: the conversion rows of the run.
            released: whether each of them released soil of an absent machine, shape (rows,).
        """
        own = conversions.rows["machine_id"] == machine_id
        rows = conversions.rows[own]
        volume = rows["volume_mm3"].astype(np.int64)
        released = released[own]
        returned = np.isin(rows["kind"], (ConversionKind.DEPOSIT, ConversionKind.OUTSIDE))
        returned &= ~released
        is_excavation = rows["kind"] == ConversionKind.EXCAVATE
        signed = np.where(is_excavation, volume, np.where(returned, -volume, 0))
        self._numbers = conversions.numbers[own]
        self._cumulative_net_volume = np.concatenate([[0], np.cumsum(signed)])
        self._cumulative_released = np.concatenate([[0], np.cumsum(np.where(released, volume, 0))])
        self.present = False
        self.pending = self.particles = self.lost_with_session = 0
        self.received = 0

    @property
    def reported_total(self) -> int:
        """All soil in the last header [mm^3]."""
        return self.pending + self.particles

    def net_volume(self, first: int, last: int) -> int:
        """Return the volume of rows `first` + 1 to `last` [mm^3]: excavated +, deposited -."""
        low, high = np.searchsorted(self._numbers, (first, last), side="right")
        return int(self._cumulative_net_volume[max(high, low)] - self._cumulative_net_volume[low])

    def released(self, last: int) -> int:
        """Return the soil released for the machine up to row `last` [mm^3]."""
        return int(self._cumulative_released[np.searchsorted(self._numbers, last, side="right")])

    def expected(self, received: int) -> int:
        """Return the soil that the machine must have after rows up to `received` [mm^3]."""
        return self.reported_total + self.net_volume(self.received, received)

    def update(self, header: MachineHeader) -> None:
        """Replace the soil by that of a new header."""
        self.pending, self.particles = header.pending_mm3, header.particles_mm3
        self.received = header.conversions_received

    def start_empty_session(self, published: int) -> None:
        """Begin an empty session; the soil of the one before is lost with it.

        Args:
            published: last conversion row published.
        """
        self.lost_with_session += self.expected(published)
        self.pending = self.particles = 0
        self.received = published

    def balances(self, last: int) -> tuple[int, int, int, int]:
        """Return (in flight, pending, particles, absent) after conversion row `last` [mm^3]."""
        in_flight = self.net_volume(self.received, last)
        absent = self.lost_with_session - self.released(last)
        if self.present:
            return in_flight, self.pending, self.particles, absent
        absent += self.reported_total
        if absent + in_flight == 0:  # all was released, rows in flight included
            return 0, 0, 0, 0
        return in_flight, 0, 0, absent

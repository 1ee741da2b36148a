"""The soil of one machine, by its headers and its conversion rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.contract.messages import MachineHeader
from msg_bridge.contract.rows import ConversionKind

__all__ = ["MachineAccount"]


@dataclass(frozen=True)
class _Holding:
    """Soil of a machine from a JOIN on.

    Attributes:
        pending, particles: soil in its last header [mm^3].
        received: number of the last conversion row included in that soil.
        pauses: (first, last) of the conversion rows published while another process took part with
            the machine id; the rows first + 1 to last are not those of this machine.
    """

    pending: int = 0
    particles: int = 0
    received: int = 0
    pauses: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class _EndedHolding:
    """Soil that another JOIN of the machine id left behind after a conversion row."""

    holding: _Holding
    published: int


class MachineAccount:
    """Account of one machine: the soil in its last header, and its conversions.

    Attributes:
        present: whether it takes part.
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
        self._holding = _Holding()
        self._before_rejoin: _Holding | None = None  # until a tick of the session is accepted
        self._ended: list[_EndedHolding] = []

    @property
    def received(self) -> int:
        """Number of the last conversion row included in the soil of the last header."""
        return self._holding.received

    @property
    def reported_total(self) -> int:
        """All soil in the last header [mm^3]."""
        return self._holding.pending + self._holding.particles

    def released(self, last: int) -> int:
        """Return the soil released for the machine up to row `last` [mm^3]."""
        return int(self._cumulative_released[np.searchsorted(self._numbers, last, side="right")])

    def expected(self, received: int) -> int:
        """Return the soil that the machine must have after rows up to `received` [mm^3]."""
        return self._expected(self._holding, received)

    def update(self, header: MachineHeader) -> None:
        """Replace the soil by that of the header of an accepted tick."""
        self._before_rejoin = None
        self._set(header)

    def drop(self) -> None:
        """End the session; one without an accepted tick leaves no trace."""
        self.present = False
        if self._before_rejoin is not None:
            self._holding, self._before_rejoin = self._before_rejoin, None

    def start_empty_session(self, published: int) -> None:
        """Begin an empty session; the soil of the one before is left behind.

        Args:
            published: last conversion row published.
        """
        self._ended.append(_EndedHolding(self._holding, published))
        self._holding = _Holding(received=published)
        self._before_rejoin = None

    def select_holding(self, header: MachineHeader, published: int) -> None:
        """Before a rejoin, return to the soil that the machine holds if it was left behind.

        Args:
            header: the request to rejoin.
            published: last conversion row published.
        """
        if self._matches(self._holding, header, published):
            return
        matching = (
            e for e in reversed(self._ended) if self._matches(e.holding, header, e.published)
        )
        ended = next(matching, None)
        if ended is None:
            return
        self._ended.remove(ended)
        self._ended.append(_EndedHolding(self._holding, published))
        former = ended.holding
        self._holding = _Holding(
            former.pending,
            former.particles,
            former.received,
            (*former.pauses, (ended.published, published)),
        )

    def rejoin(self, header: MachineHeader) -> None:
        """Continue the account with a request to rejoin."""
        before = self._holding
        self._set(header)
        self._before_rejoin = before

    def balances(self, last: int) -> tuple[int, int, int, int]:
        """Return (in flight, pending, particles, absent) after conversion row `last` [mm^3]."""
        holding = self._holding
        in_flight = self._net_volume(holding, holding.received, last)
        absent = sum(self._expected(each.holding, each.published) for each in self._ended)
        absent -= self.released(last)
        if self.present:
            return in_flight, holding.pending, holding.particles, absent
        absent += self.reported_total
        if absent + in_flight == 0:  # all was released, rows in flight included
            return 0, 0, 0, 0
        return in_flight, 0, 0, absent

    def _set(self, header: MachineHeader) -> None:
        self._holding = replace(
            self._holding,
            pending=header.pending_mm3,
            particles=header.particles_mm3,
            received=header.conversions_received,
        )

    def _matches(self, holding: _Holding, header: MachineHeader, published: int) -> bool:
        """Return whether a header reports a holding whose rows end with `published`."""
        received = header.conversions_received
        expected = self._expected(holding, min(received, published))
        return received >= holding.received and header.soil_mm3 == expected

    def _expected(self, holding: _Holding, received: int) -> int:
        """Return the soil of a holding after rows up to `received` [mm^3]."""
        reported = holding.pending + holding.particles
        return reported + self._net_volume(holding, holding.received, received)

    def _net_volume(self, holding: _Holding, first: int, last: int) -> int:
        """Return the volume of rows `first` + 1 to `last` [mm^3]: excavated +, deposited -."""
        volume = self._raw_net_volume(first, last)
        for begin, end in holding.pauses:
            volume -= self._raw_net_volume(max(first, begin), min(last, end))
        return volume

    def _raw_net_volume(self, first: int, last: int) -> int:
        low, high = np.searchsorted(self._numbers, (first, last), side="right")
        return int(self._cumulative_net_volume[max(high, low)] - self._cumulative_net_volume[low])

"""Find the conversion rows that put down the soil of absent machines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.membership import MembershipChange, MembershipEvent, MembershipTimeline
from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.contract.messages import SoilHeader, Stream
from msg_bridge.contract.rows import ConversionKind, machine_ids_in

__all__ = ["find_released_rows"]

_PARTICIPATING = {MembershipChange.STEPPED, MembershipChange.LEFT, MembershipChange.PRESENT}


def find_released_rows(
    soil: SoilTicks, timeline: MembershipTimeline, conversions: NumberedRows
) -> NDArray[np.bool_]:
    """Return which conversion rows released absent soil, shape (rows,).

    Those of ended sessions of machines that have joined again have the machine id 0. The others
    name a machine that does not take part in their tick, and answer no deposit request. Their
    particle numbers do not distinguish them.
    """
    rows = conversions.rows
    put_down = (rows["kind"] == ConversionKind.DEPOSIT) | (rows["kind"] == ConversionKind.OUTSIDE)
    index = np.searchsorted(soil.spans[Stream.CONVERSION].last, conversions.numbers)
    index = np.minimum(index, len(soil.headers) - 1)
    released = np.zeros(rows.size, dtype=np.bool_)
    for machine_id in machine_ids_in(rows):
        participates = np.array(
            [
                _participates(machine_id, header, events)
                for header, events in zip(soil.headers, timeline.events, strict=True)
            ]
        )
        released |= put_down & (rows["machine_id"] == machine_id) & ~participates[index]
    return released


def _participates(machine_id: int, header: SoilHeader, events: list[MembershipEvent]) -> bool:
    """Return whether rows of a soil tick can be answers to a machine; also to a late one."""
    changes = {event.change for event in events if event.session.machine_id == machine_id}
    if changes & _PARTICIPATING:
        return True
    return not changes and any(receipt.machine_id == machine_id for receipt in header.receipts)

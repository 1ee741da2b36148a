"""Which machines took part in a tick of the soil, and how, from the headers of two ticks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from earthmoving_sim.replay.recorded.run_survey import SessionId
from msg_bridge.contract.messages import SoilHeader

__all__ = ["SoilTickInputs", "find_inputs"]


@dataclass(frozen=True)
class SoilTickInputs:
    """Inputs of a tick of the soil.

    Attributes:
        dropped: sessions that ended before the tick, without LEAVE.
        processed: last tick of each session that is part of this tick; of LEAVE, too.
        left: sessions that end with this tick.
        joined: sessions that begin at the end of the tick.
    """

    dropped: tuple[SessionId, ...]
    processed: Mapping[SessionId, int]
    left: frozenset[SessionId]
    joined: tuple[SessionId, ...]


def find_inputs(
    before: SoilHeader | None, header: SoilHeader, last_ticks: Mapping[SessionId, int]
) -> SoilTickInputs:
    """Return the inputs of a tick.

    Args:
        before: header of the tick before; None for the first.
        header: header of the tick.
        last_ticks: last tick of each session that ended with LEAVE.
    """
    ticks_before = _ticks(before) if before is not None else {}
    ticks = _ticks(header)
    ended = ticks_before.keys() - ticks.keys()
    left = {each for each in ended if last_ticks.get(each, -1) > ticks_before[each]}
    processed = {
        each: tick
        for each, tick in ticks.items()
        if each in ticks_before and tick > ticks_before[each]
    }
    processed |= {each: last_ticks[each] for each in left}
    return SoilTickInputs(
        dropped=tuple(sorted(ended - left)),
        processed=dict(sorted(processed.items())),
        left=frozenset(left),
        joined=tuple(sorted(ticks.keys() - ticks_before.keys())),
    )


def _ticks(header: SoilHeader) -> dict[SessionId, int]:
    return {SessionId(each.machine_id, each.session_id): each.tick for each in header.receipts}

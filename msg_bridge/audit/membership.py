"""Reconstruct which machine header the soil accepted in which tick from the soil's receipts.

`tick` of a receipt is the last machine tick that the soil accepted. In lockstep that is the soil
header's own tick; in real time it is older where the soil did not wait for a late machine. A
machine that was dropped has no receipt any more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from msg_bridge.audit.collect import RunData, SessionKey
from msg_bridge.audit.numbered_rows import Numbers
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.contract.messages import MachineHeader, MachineReceipt, SoilHeader, Verb

__all__ = [
    "UNKNOWN_TICK",
    "MembershipChange",
    "MembershipEvent",
    "MembershipTimeline",
    "build_timeline",
]

UNKNOWN_TICK = -1
"""Soil tick of an accepted header if the soil header of that tick is missing."""


class MembershipChange(Enum):
    """What happened to a machine in a soil tick."""

    PRESENT = "present"
    """It already takes part where the bag begins."""
    JOINED = "joined"
    """It takes part from the next tick on."""
    STEPPED = "stepped"
    """A header of it was accepted."""
    LEFT = "left"
    """Its last header, with verb LEAVE, was accepted."""
    DROPPED = "dropped"
    """It has no receipt any more and did not leave."""


@dataclass(frozen=True)
class MembershipEvent:
    """A machine in one soil tick.

    Attributes:
        change: what happened.
        session: its session.
        tick: tick of the accepted header.
        header: the accepted header; None if it is missing, or DROPPED.
        backlog: number of conversion rows that it is sent on joining.
    """

    change: MembershipChange
    session: SessionKey
    tick: int
    header: MachineHeader | None
    backlog: int = 0

    @property
    def is_header_missing(self) -> bool:
        """Whether the accepted header is missing from the bag."""
        return self.header is None and self.change is not MembershipChange.DROPPED


@dataclass
class MembershipTimeline:
    """Membership of all machines over a run.

    Attributes:
        events: the events of each soil header.
        accepted: by session, (machine tick, soil tick) of every accepted header, ascending; the
            sessions in the order in which they began.
        numbering_session: by session, the id of the session in which its particle numbers began:
            that of the JOIN of its machine, since a REJOIN continues them.
    """

    events: list[list[MembershipEvent]] = field(default_factory=list)
    accepted: dict[SessionKey, list[tuple[int, int]]] = field(default_factory=dict)
    numbering_session: dict[SessionKey, int] = field(default_factory=dict)

    def soil_ticks(self, session: SessionKey) -> Numbers:
        """Return the soil tick that accepted each header of a session, shape (n,)."""
        return np.array([soil for _, soil in self.accepted.get(session, [])], dtype=np.int64)


def build_timeline(soil: SoilTicks, data: RunData) -> MembershipTimeline:
    """Reconstruct the membership of all machines."""
    return _TimelineBuilder(soil, data).build()


class _TimelineBuilder:
    """Compares the receipts of consecutive soil headers."""

    def __init__(self, soil: SoilTicks, data: RunData) -> None:
        self._soil, self._data = soil, data
        self._timeline = MembershipTimeline()
        self._last_accepted: dict[SessionKey, int] = {}  # machine tick

    def build(self) -> MembershipTimeline:
        """Add the events of all soil headers."""
        previous: dict[int, MachineReceipt] = {}
        for index, header in enumerate(self._soil.headers):
            receipts = {receipt.machine_id: receipt for receipt in header.receipts}
            events = []
            for machine_id, before in previous.items():
                receipt = receipts.get(machine_id)
                continues = receipt is not None and receipt.session_id == before.session_id
                event = self._update(index, header, before, receipt if continues else None)
                if event is not None:
                    events.append(event)
            for machine_id, receipt in receipts.items():
                known = previous.get(machine_id)
                if known is None or known.session_id != receipt.session_id:
                    is_present = index == 0 and not self._soil.from_start
                    add = self._add_present if is_present else self._add_joined
                    events.append(add(header, receipt))
            self._timeline.events.append(events)
            previous = receipts
        return self._timeline

    def _update(
        self,
        index: int,
        header: SoilHeader,
        before: MachineReceipt,
        receipt: MachineReceipt | None,
    ) -> MembershipEvent | None:
        """Return what happened to a machine that took part; None if it is late.

        Args:
            index, header: the soil header.
            before: its receipt in the soil header before.
            receipt: its receipt; None if it takes part no longer.
        """
        session = SessionKey(before.machine_id, before.session_id)
        steps = self._data.steps.get(session, {})
        begin = self._last_accepted[session] + 1
        if receipt is not None:
            change, last = MembershipChange.STEPPED, receipt.tick
            if last < begin:
                return None
        else:
            leaving = [
                tick
                for tick in range(begin, header.tick + 1)
                if tick in steps and steps[tick].verb is Verb.LEAVE
            ]
            if not leaving:
                return MembershipEvent(MembershipChange.DROPPED, session, header.tick, None)
            change, last = MembershipChange.LEFT, leaving[-1]
        follows = index > 0 and header.tick == self._soil.headers[index - 1].tick + 1
        soil_tick = header.tick if follows else UNKNOWN_TICK
        for tick in range(begin, last + 1):
            if tick in steps:
                self._accept(session, tick, soil_tick)
        self._last_accepted[session] = last
        return MembershipEvent(change, session, last, steps.get(last))

    def _add_present(self, header: SoilHeader, receipt: MachineReceipt) -> MembershipEvent:
        """Return the event of a machine that takes part already where the bag begins."""
        session, last = self._begin_session(receipt)
        self._timeline.numbering_session[session] = session.session_id
        step = self._data.steps.get(session, {}).get(last)
        if step is not None:
            self._accept(session, last, header.tick)
        return MembershipEvent(MembershipChange.PRESENT, session, last, step)

    def _add_joined(self, header: SoilHeader, receipt: MachineReceipt) -> MembershipEvent:
        """Return the event of a machine that takes part from the next tick on."""
        session, _ = self._begin_session(receipt)
        join = self._data.joins.get(session)
        numbering = self._timeline.numbering_session
        former = [each for each in numbering if each.machine_id == session.machine_id]
        rejoins = join is not None and join.verb is Verb.REJOIN
        numbering[session] = session.session_id
        if rejoins and former:
            # A machine counts its sessions up; another process with its id begins elsewhere.
            before = [each for each in former if each.session_id < session.session_id]
            numbering[session] = numbering[max(before) if before else former[-1]]
        return MembershipEvent(MembershipChange.JOINED, session, header.tick, join, receipt.backlog)

    def _begin_session(self, receipt: MachineReceipt) -> tuple[SessionKey, int]:
        """Return a new session and its last accepted tick."""
        session = SessionKey(receipt.machine_id, receipt.session_id)
        self._last_accepted[session] = receipt.tick
        return session, receipt.tick

    def _accept(self, session: SessionKey, tick: int, soil_tick: int) -> None:
        self._timeline.accepted.setdefault(session, []).append((tick, soil_tick))

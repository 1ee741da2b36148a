"""The soil's side: the soil and its end of the exchange, one tick at a time.

What a node runs over topics and a world of one process runs directly. Messages go in by
`receive`, come out by `take_outbox`, and `advance` does a tick when it can be done.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.contract.rows import (
    CHANGED,
    CONVERSION,
    FORCE,
    LANDED,
    MAX_ROW_VOLUME,
    Rows,
    empty_rows,
    join_rows,
)
from msg_bridge.exchange.soil_side import SoilExchange, TickInput
from soil_sim.held import HeldSoils
from soil_sim.soil import Soil, SoilStep

__all__ = ["SoilSide", "SoilTick"]


@dataclass(frozen=True)
class SoilTick:
    """A tick that was done.

    Attributes:
        ledger: of the tick.
        step: what the soil moved.
    """

    ledger: Ledger
    step: SoilStep


class SoilSide:
    """The soil behind its end of the exchange.

    Attributes:
        soil: the terrain.
        exchange: the barrier of the tick and the keeper of the ledger.
    """

    def __init__(self, soil: Soil, *, expected: Iterable[int] = (1,), epoch: int = 1) -> None:
        """
        Args:
            soil: the terrain.
            expected: sources without which tick 1 does not begin.
            epoch: number of this run.
        """
        self.soil = soil
        self.exchange = SoilExchange(
            soil.grid,
            lambda: soil.columns.height,
            layers=lambda: soil.layers,
            expected=expected,
            epoch=epoch,
        )
        self._places: dict[int, Sequence[float]] = {}  # x, y, z [m] by source
        self._held = HeldSoils()
        self._releasing: list[int] = []

    @property
    def tick(self) -> int:
        """Number of the last tick done; -1 before the welcome, which is tick 0."""
        return self.exchange.tick

    def receive(self, message: Message) -> None:
        """Take one message from a machine.

        Raises:
            ExchangeError: it breaks the exchange; nothing was changed.
        """
        self.exchange.receive(message)

    def take_outbox(self) -> list[Message]:
        """The messages to carry to all machines, in order; empties the box."""
        return self.exchange.take_outbox()

    def advance(self, *, wait: bool = True) -> SoilTick | None:
        """Do the next tick if its parts are here; None if not.

        Args:
            wait: for late machines; see `SoilExchange.poll`.
        """
        tick = self.exchange.poll(wait=wait)
        if tick is None:
            return None
        if tick.tick == 0:
            nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(CHANGED))
            step = SoilStep(*nothing, ())
        else:
            step = self._step(tick)
        ledger = self.exchange.answer(
            step.conversions,
            step.forces,
            step.changed,
            revision=self.soil.revision,
            terrain_mm3=self.soil.total_mm3,
        )
        self._held.book(step.conversions)
        return SoilTick(ledger, step)

    def release_absent(self) -> tuple[int, ...]:
        """Let what absent machines held become terrain in the next tick, where they last swept.

        It is of the kind that most of it was, and as moist as all of it together. One that asks to
        come back before that tick keeps what it holds.

        Returns:
            The sources whose soil is released.
        """
        self._releasing = list(self.exchange.releasable)
        return tuple(self._releasing)

    def _step(self, tick: TickInput) -> SoilStep:
        self._note_places(tick.sweeps)
        released = [self._released(source) for source in self._still_absent()]
        self._releasing = []
        landed = join_rows([tick.landed, *released], LANDED)
        return self.soil.step(tick.tick, tick.sweeps, landed)

    def _note_places(self, sweeps: Rows) -> None:
        """Where the bucket of each machine is now."""
        (first,) = ((sweeps["pair"] == 0) & (sweeps["tool"] == 0)).nonzero()
        columns = (sweeps[name][first].tolist() for name in ("source", "x1", "y1", "z1"))
        for source, *place in zip(*columns, strict=True):
            # Rows are judged later; soil cannot be put down at a place that is none.
            if all(map(math.isfinite, place)):
                self._places[source] = place

    def _still_absent(self) -> list[int]:
        return [n for n in self._releasing if n in self.exchange.releasable]

    def _released(self, source: int) -> Rows:
        """LANDED rows of all that an absent source held."""
        volume = self.exchange.release(source)
        rows = empty_rows(LANDED, -(-volume // MAX_ROW_VOLUME))
        rows["volume_mm3"] = MAX_ROW_VOLUME
        rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - volume)
        rows["source"] = source
        rows["particle_id"] = np.arange(rows.size)  # there are no particles; told apart by this
        rows["soil"], rows["moisture"] = self._held.mean(source)
        rows["x"], rows["y"], rows["z"] = self._places.get(source, (0.0, 0.0, 0.0))
        return rows

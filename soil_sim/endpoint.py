"""The soil's side: the soil and its end of the exchange, one tick at a time.

What a node runs over topics and a world of one process runs directly. Messages go in by
`receive`, come out by `drain_outbox`, and `advance` does a tick when it can be done.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    FORCE,
    MAP_UPDATE,
    MAX_ROW_VOLUME,
    Rows,
    empty_rows,
    join_rows,
)
from msg_bridge.exchange.soil_exchange import SoilExchange, TickInput
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soil_inventory import SoilInventory

__all__ = ["SoilEndpoint", "SoilTickResult"]


@dataclass(frozen=True)
class SoilTickResult:
    """A tick that was done.

    Attributes:
        ledger: of the tick.
        step: what the soil moved.
    """

    ledger: Ledger
    step: SoilStepResult


class SoilEndpoint:
    """The soil behind its end of the exchange.

    Attributes:
        soil: the terrain.
        exchange: the barrier of the tick and the keeper of the ledger.
    """

    def __init__(self, soil: Soil, *, expected: Iterable[int] = (1,), run_id: int = 1) -> None:
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
            run_id=run_id,
        )
        self._tool_positions: dict[int, Sequence[float]] = {}  # x, y, z [m] by source
        self._inventory = SoilInventory()
        self._machines_to_release: list[int] = []

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

    def drain_outbox(self) -> list[Message]:
        """The messages to carry to all machines, in order; empties the box."""
        return self.exchange.drain_outbox()

    def advance(self, *, wait: bool = True) -> SoilTickResult | None:
        """Do the next tick if its parts are here; None if not.

        Args:
            wait: for late machines; see `SoilExchange.poll`.
        """
        tick = self.exchange.poll(wait=wait)
        if tick is None:
            return None
        if tick.tick == 0:
            nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
            step = SoilStepResult(*nothing, ())
        else:
            step = self._step(tick)
        ledger = self.exchange.answer(
            step.conversions,
            step.forces,
            step.map_updates,
            revision=self.soil.revision,
            terrain_mm3=self.soil.total_mm3,
        )
        self._inventory.record_conversions(step.conversions)
        return SoilTickResult(ledger, step)

    def release_absent_soil(self) -> tuple[int, ...]:
        """Let what absent machines held become terrain in the next tick, where they last swept.

        It is of the kind that most of it was, and as moist as all of it together. One that asks to
        come back before that tick keeps what it holds.

        Returns:
            The sources whose soil is released.
        """
        self._machines_to_release = list(self.exchange.releasable_machines)
        return tuple(self._machines_to_release)

    def _step(self, tick: TickInput) -> SoilStepResult:
        self._record_tool_positions(tick.sweeps)
        released = [
            self._release_rows(machine_id) for machine_id in self._absent_machines_to_release()
        ]
        self._machines_to_release = []
        deposit_requests = join_rows([tick.deposit_requests, *released], DEPOSIT_REQUEST)
        return self.soil.step(tick.tick, tick.sweeps, deposit_requests)

    def _record_tool_positions(self, sweeps: Rows) -> None:
        """Where the bucket of each machine is now."""
        (first,) = ((sweeps["pair"] == 0) & (sweeps["tool"] == 0)).nonzero()
        columns = (sweeps[name][first].tolist() for name in ("machine_id", "x1", "y1", "z1"))
        for machine_id, *place in zip(*columns, strict=True):
            # Rows are judged later; soil cannot be put down at a place that is none.
            if all(map(math.isfinite, place)):
                self._tool_positions[machine_id] = place

    def _absent_machines_to_release(self) -> list[int]:
        return [n for n in self._machines_to_release if n in self.exchange.releasable_machines]

    def _release_rows(self, machine_id: int) -> Rows:
        """LANDED rows of all that an absent source held."""
        volume = self.exchange.release(machine_id)
        rows = empty_rows(DEPOSIT_REQUEST, -(-volume // MAX_ROW_VOLUME))
        rows["volume_mm3"] = MAX_ROW_VOLUME
        rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - volume)
        rows["machine_id"] = machine_id
        rows["particle_id"] = np.arange(rows.size)  # there are no particles; told apart by this
        rows["soil"], rows["moisture"] = self._inventory.majority_soil(machine_id)
        rows["x"], rows["y"], rows["z"] = self._tool_positions.get(machine_id, (0.0, 0.0, 0.0))
        return rows

"""The soil and its end of the exchange, one tick at a time, independent of the transport.

`receive` takes messages, `drain_outbox` returns those to send, and `advance` computes the next tick
once it is complete.
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
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.tick_input import TickInput
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soil_inventory import SoilInventory

__all__ = ["SoilEndpoint", "SoilTickResult"]


@dataclass(frozen=True)
class SoilTickResult:
    """Result of one tick.

    Attributes:
        ledger: ledger at the end of the tick.
        step: rows that the soil computed.
    """

    ledger: Ledger
    step: SoilStepResult


class SoilEndpoint:
    """Soil connected to the exchange.

    Attributes:
        soil: terrain.
        exchange: barrier of the tick and owner of the ledger.
    """

    def __init__(self, soil: Soil, *, expected: Iterable[int] = (1,), run_id: int = 1) -> None:
        """
        Args:
            soil: terrain.
            expected: ids of the machines that must join before tick 1.
            run_id: id of this run.
        """
        self.soil = soil
        self.exchange = SoilExchange(
            soil.grid,
            lambda: soil.columns.height,
            layers=lambda: soil.layers,
            expected=expected,
            run_id=run_id,
        )
        self._tool_positions: dict[int, Sequence[float]] = {}  # x, y, z [m] by machine id
        self._inventory = SoilInventory()
        self._machines_to_release: list[int] = []

    @property
    def tick(self) -> int:
        """Number of the last tick; -1 before tick 0, which only admits machines."""
        return self.exchange.tick

    def receive(self, message: Message) -> None:
        """Process one message of a machine.

        Raises:
            ExchangeError: the message violates the protocol; nothing was changed.
        """
        self.exchange.receive(message)

    def drain_outbox(self) -> list[Message]:
        """Return the messages to send to all machines, in order, and clear them."""
        return self.exchange.drain_outbox()

    def advance(self, *, wait: bool = True) -> SoilTickResult | None:
        """Compute the next tick if it is complete, else return None.

        Args:
            wait: whether to wait for late machines; see `SoilExchange.poll`.
        """
        tick = self.exchange.poll(wait=wait)
        if tick is None:
            return None
        if tick.tick == 0:
            no_rows = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
            step = SoilStepResult(*no_rows, ())
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
        """Turn the soil of absent machines into terrain in the next tick, at their last tool
        position.

        It gets the majority kind and the mean moisture of what the machine held. A machine that
        requests to rejoin before that tick keeps its soil.

        Returns:
            Ids of the machines whose soil is released.
        """
        self._machines_to_release = list(self.exchange.releasable_machines)
        return tuple(self._machines_to_release)

    def _step(self, tick: TickInput) -> SoilStepResult:
        self._record_tool_positions(tick.sweeps)
        released = [
            self.release_rows(machine_id) for machine_id in self._absent_machines_to_release()
        ]
        self._machines_to_release = []
        deposit_requests = join_rows([tick.deposit_requests, *released], DEPOSIT_REQUEST)
        return self.soil.step(tick.tick, tick.sweeps, deposit_requests)

    def _record_tool_positions(self, sweeps: Rows) -> None:
        """Record the position of the first tool of each machine."""
        (first,) = ((sweeps["pair"] == 0) & (sweeps["tool"] == 0)).nonzero()
        columns = (sweeps[name][first].tolist() for name in ("machine_id", "x1", "y1", "z1"))
        for machine_id, *position in zip(*columns, strict=True):
            # Rows are validated later; a position that is not finite cannot take soil.
            if all(map(math.isfinite, position)):
                self._tool_positions[machine_id] = position

    def _absent_machines_to_release(self) -> list[int]:
        return [n for n in self._machines_to_release if n in self.exchange.releasable_machines]

    def release_rows(self, machine_id: int) -> Rows:
        """Return DEPOSIT_REQUEST rows of all soil that an absent machine held."""
        volume = self.exchange.release(machine_id)
        rows = empty_rows(DEPOSIT_REQUEST, -(-volume // MAX_ROW_VOLUME))
        rows["volume_mm3"] = MAX_ROW_VOLUME
        rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - volume)
        rows["machine_id"] = machine_id
        rows["particle_id"] = np.arange(rows.size)  # not particles; only distinguishes the rows
        rows["soil"], rows["moisture"] = self._inventory.majority_soil(machine_id)
        rows["x"], rows["y"], rows["z"] = self._tool_positions.get(machine_id, (0.0, 0.0, 0.0))
        return rows

"""The soil and its end of the exchange, one tick at a time, independent of the transport.

`receive` takes messages, `drain_outbox` returns those to send, and `advance` computes the next tick
once it is complete.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    ENDED_SESSION,
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
from soil_sim.sweep_limits import SweepLimits

__all__ = ["SoilEndpoint", "SoilTickResult"]

_ORIGIN = (0.0, 0.0, 0.0)
"""Position of the soil of a machine whose tools never had a valid sweep."""


@dataclass(frozen=True)
class SoilTickResult:
    """Result of one tick.

    Attributes:
        ledger: ledger at the end of the tick.
        step: rows that the soil computed.
    """

    ledger: Ledger
    step: SoilStepResult


@dataclass(frozen=True)
class _SoilLeftBehind:
    """Soil of a machine that does not hold it any more.

    Attributes:
        volume: bank volume [mm^3].
        position: position of its first tool, x, y, z [m].
        soil: id of the kind, and moisture [%].
    """

    volume: int
    position: Sequence[float]
    soil: tuple[int, int]

    def deposit_requests(self, machine_id: int) -> Rows:
        """Return DEPOSIT_REQUEST rows of all of it.

        Args:
            machine_id: machine id of the rows.
        """
        rows = empty_rows(DEPOSIT_REQUEST, -(-self.volume // MAX_ROW_VOLUME))
        rows["volume_mm3"] = MAX_ROW_VOLUME
        rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - self.volume)
        rows["machine_id"] = machine_id
        rows["particle_id"] = np.arange(rows.size)  # not particles; only distinguishes the rows
        rows["soil"], rows["moisture"] = self.soil
        rows["x"], rows["y"], rows["z"] = self.position
        return rows


class SoilEndpoint:
    """Soil connected to the exchange.

    Attributes:
        soil: terrain.
        exchange: barrier of the tick and owner of the ledger.
    """

    def __init__(
        self,
        soil: Soil,
        *,
        expected: Iterable[int] = (1,),
        admit_others: bool = False,
        max_tool_displacement: float = math.inf,
        run_id: int = 1,
    ) -> None:
        """
        Args:
            soil: terrain.
            expected: ids of the machines that must join before tick 1.
            admit_others: whether machines with other ids may join, too.
            max_tool_displacement: maximum displacement of a key point of a tool in a tick [m];
                sweeps are then also checked for continuity. Infinite: they are not checked.
            run_id: id of this run.
        """
        self.soil = soil
        self.exchange = SoilExchange(
            soil.grid,
            lambda: soil.columns.height,
            layers=lambda: soil.layers,
            expected=expected,
            admit_others=admit_others,
            run_id=run_id,
        )
        self._tool_positions: dict[int, Sequence[float]] = {}  # x, y, z [m] by machine id
        self._inventory = SoilInventory()
        self._machines_to_release: list[int] = []
        self._sweep_limits = (
            SweepLimits(max_tool_displacement) if math.isfinite(max_tool_displacement) else None
        )
        self._left_behind: dict[int, _SoilLeftBehind] = {}  # by ended sessions, by machine id
        self._release_left_behind = False

    @property
    def tick(self) -> int:
        """Number of the last tick; -1 before tick 0, which only admits machines."""
        return self.exchange.tick

    def receive(self, message: Message) -> bool:
        """Process one message of a machine.

        Returns:
            Whether it is of the session in which its machine takes part.

        Raises:
            ExchangeError: the message violates the protocol; nothing was changed.
        """
        return self.exchange.receive(message)

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
        self._record_left_behind()
        return SoilTickResult(ledger, step)

    def release_absent_soil(self) -> tuple[int, ...]:
        """Turn absent soil into terrain in the next tick, at the last tool position of its machine.

        That is the soil of machines that take no part, and the soil that joined machines left
        behind in earlier sessions. It gets the majority kind and the mean moisture of what the
        machine held. A machine that requests to rejoin before that tick keeps its soil.

        Returns:
            Ids of the machines whose soil is released, ascending.
        """
        self._machines_to_release = list(self.exchange.releasable_machines)
        self._release_left_behind = bool(self.exchange.accounts.forfeited)
        return tuple(sorted({*self._machines_to_release, *self.exchange.accounts.forfeited}))

    def _step(self, tick: TickInput) -> SoilStepResult:
        sweeps = tick.sweeps
        rejected: tuple[str, ...] = ()
        if self._sweep_limits is not None:
            self._sweep_limits.update_sessions(self.exchange.session_ids)
            sweeps, rejected = self._sweep_limits.check(tick.tick, sweeps)
        self._record_tool_positions(sweeps)
        released = [
            self.release_rows(machine_id) for machine_id in self._absent_machines_to_release()
        ]
        if self._release_left_behind:
            released.append(self._rows_left_behind())
        self._machines_to_release, self._release_left_behind = [], False
        deposit_requests = join_rows([tick.deposit_requests, *released], DEPOSIT_REQUEST)
        step = self.soil.step(tick.tick, sweeps, deposit_requests)
        return replace(step, rejected_tools=(*rejected, *step.rejected_tools))

    def _record_tool_positions(self, sweeps: Rows) -> None:
        """Record the position of the first tool of each machine."""
        (first,) = ((sweeps["pair"] == 0) & (sweeps["tool"] == 0)).nonzero()
        columns = (sweeps[name][first].tolist() for name in ("machine_id", "x1", "y1", "z1"))
        for machine_id, *position in zip(*columns, strict=True):
            # Rows are validated later; a position that is not finite cannot take soil.
            if all(map(math.isfinite, position)):
                self._tool_positions[machine_id] = position

    def _record_left_behind(self) -> None:
        """Record where and of which kind soil is that a machine which has joined again left behind.

        Its first sweep and excavation of the new session come after the tick that admits it.
        """
        forfeited = self.exchange.accounts.forfeited
        for machine_id, volume in forfeited.items():
            before = self._left_behind.get(machine_id)
            if before is None or before.volume != volume:
                self._left_behind[machine_id] = _SoilLeftBehind(
                    volume,
                    self._tool_positions.get(machine_id, _ORIGIN),
                    self._inventory.majority_soil(machine_id),
                )
                self._inventory.remove(machine_id)
        self._left_behind = {n: self._left_behind[n] for n in forfeited}

    def _absent_machines_to_release(self) -> list[int]:
        return [n for n in self._machines_to_release if n in self.exchange.releasable_machines]

    def release_rows(self, machine_id: int) -> Rows:
        """Return DEPOSIT_REQUEST rows of all soil that an absent machine held."""
        soil = _SoilLeftBehind(
            self.exchange.release(machine_id),
            self._tool_positions.get(machine_id, _ORIGIN),
            self._inventory.majority_soil(machine_id),
        )
        return soil.deposit_requests(machine_id)

    def _rows_left_behind(self) -> Rows:
        """Return DEPOSIT_REQUEST rows of the soil of ended sessions of joined machines."""
        parts = [
            replace(
                self._left_behind[machine_id], volume=self.exchange.release_forfeited(machine_id)
            ).deposit_requests(ENDED_SESSION)
            for machine_id in self.exchange.accounts.forfeited
        ]
        rows = join_rows(parts, DEPOSIT_REQUEST)
        rows["particle_id"] = np.arange(rows.size)
        return rows

"""The soil and its end of the exchange, one tick at a time, independent of the transport.

`receive` takes messages, `drain_outbox` returns those to send, and `advance` computes the next tick
once it is complete.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from msg_bridge.exchange.welcome import Layers, Welcome
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soil_inventory import SoilInventory
from soil_sim.sweep_limits import SweepLimits
from soil_sim.tool_sweeps import positions_of_first_tools

__all__ = ["SoilEndpoint", "SoilTickResult", "split_into_deposit_requests"]

_MAX_UNREAD_TICKS = 64
"""Number of ticks after which the positions of tools are read: only the last ones are used, where
soil is released."""

_ORIGIN = (0.0, 0.0, 0.0)
"""Position of the soil of a machine whose tools never had a valid sweep."""


class SoilTickResult(NamedTuple):
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

    def __init__(
        self,
        soil: Soil,
        *,
        expected: Iterable[int] = (1,),
        admit_others: bool = False,
        max_tool_displacement: float = math.inf,
        run_id: int = 1,
        terrain_by_transport: bool = False,
    ) -> None:
        """
        Args:
            soil: terrain.
            expected: ids of the machines that must join before tick 1.
            admit_others: whether machines with other ids may join, too.
            max_tool_displacement: maximum displacement of a key point of a tool in a tick [m];
                sweeps are then also checked for continuity. Infinite: they are not checked.
            run_id: id of this run.
            terrain_by_transport: whether the transport sends terrain in its own way; it gets
                `KeyframeDue` then.
        """
        self.soil = soil
        self.exchange = SoilExchange(
            Welcome(soil.grid, self._elevation, self._layers, by_transport=terrain_by_transport),
            expected=expected,
            admit_others=admit_others,
            run_id=run_id,
        )
        self._tool_positions: dict[int, Sequence[float]] = {}  # x, y, z [m] by account
        # Sweeps with the accounts of their machines, of which the positions are not read yet.
        self._unread_sweeps: list[tuple[Rows, Mapping[int, int]]] = []
        self._inventory = SoilInventory()  # by account
        self._account_numbers: frozenset[int] = frozenset()  # at the end of the last tick
        # Machine ids of a requested release: whose soil, and whose ended accounts, are released.
        self._machines_to_release: tuple[int, ...] = ()
        self._ended_to_release: tuple[int, ...] = ()
        self._sweep_limits = (
            SweepLimits(max_tool_displacement) if math.isfinite(max_tool_displacement) else None
        )

    def _elevation(self) -> NDArray[np.float64]:
        return self.soil.columns.height

    def _layers(self) -> Layers:
        return self.soil.layers

    @property
    def tick(self) -> int:
        """Number of the last tick; -1 before tick 0, which only admits machines."""
        return self.exchange.tick

    def receive(self, message: Message) -> bool:
        """Process one message of a machine.

        Returns:
            Whether its machine can have sent it now; see `SoilExchange.receive`.

        Raises:
            ExchangeError: the message violates the protocol; nothing was changed.
        """
        return self.exchange.receive(message)

    def drain_outbox(self) -> list[Message]:
        """Return the messages to send to all machines, in order, and clear them."""
        return self.exchange.drain_outbox()

    def advance(
        self, *, wait: bool = True, record: Callable[[], None] | None = None
    ) -> SoilTickResult | None:
        """Compute the next tick if it is complete, else return None.

        Args:
            wait: whether to wait for late machines; see `SoilExchange.poll`.
            record: called before the tick is computed, when `SoilExchange.polled_messages` returns
                its messages.
        """
        tick = self.exchange.poll(wait=wait)
        if tick is None:
            return None
        if record is not None:
            record()
        accounts = self.exchange.accounts.joined_accounts  # of the machines in this tick
        if tick.tick == 0:
            no_rows = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
            step = SoilStepResult(*no_rows, ())
        else:
            step = self._step(tick, accounts)
        ledger = self.exchange.answer(
            step.conversions,
            step.forces,
            step.map_updates,
            revision=self.soil.revision,
            terrain_mm3=self.soil.total_mm3,
        )
        self._inventory.record_conversions(step.conversions, accounts)
        self._update_ended_accounts()
        return SoilTickResult(ledger, step)

    def release_absent_soil(self) -> tuple[int, ...]:
        """Turn absent soil into terrain in the next tick, at the last tool position of its machine.

        That is the soil of machines that take no part, and of the ended accounts of joined
        machines. The soil of each account (see `LedgerAccounts`) gets the majority kind and the
        mean moisture of what its machine excavated. A machine that requests to rejoin before that
        tick keeps its soil.

        Returns:
            Ids of the machines whose soil is released, ascending.
        """
        self._machines_to_release = self.exchange.releasable_machines
        self._ended_to_release = self.exchange.machines_with_ended_accounts
        return tuple(sorted({*self._machines_to_release, *self.exchange.accounts.ended_volumes}))

    def _step(self, tick: TickInput, accounts: Mapping[int, int]) -> SoilStepResult:
        """Compute a tick; `accounts` are those of the machines in it, by machine id."""
        sweeps = tick.sweeps
        rejected: tuple[str, ...] = ()
        if self._sweep_limits is not None:
            self._sweep_limits.update_sessions(self.exchange.session_ids)
            sweeps, rejected = self._sweep_limits.check(tick.tick, sweeps)
        self._unread_sweeps.append((sweeps, accounts))
        if len(self._unread_sweeps) == _MAX_UNREAD_TICKS:
            self._read_tool_positions()
        deposit_requests = tick.deposit_requests
        if self._machines_to_release or self._ended_to_release:
            deposit_requests = join_rows([deposit_requests, self._release()], DEPOSIT_REQUEST)
        step = self.soil.step(tick.tick, sweeps, deposit_requests)
        if not rejected:
            return step
        return step._replace(rejected_tools=(*rejected, *step.rejected_tools))

    def _read_tool_positions(self) -> None:
        """Record the last position of the first tool of each account."""
        unread, self._unread_sweeps = self._unread_sweeps, []
        last: dict[int, Sequence[float]] = {}
        for sweeps, accounts in reversed(unread):
            if not last.keys() >= set(accounts.values()):
                positions = positions_of_first_tools(np.ascontiguousarray(sweeps)).tolist()
                last = {accounts[int(machine_id)]: each for machine_id, *each in positions} | last
        self._tool_positions |= last

    def _update_ended_accounts(self) -> None:
        """Merge positions and inventories of merged accounts; discard those of discarded ones.

        A merged account has the position of the last account that was added to it.
        """
        accounts = self.exchange.accounts.account_numbers
        if accounts is self._account_numbers:  # as in most ticks
            return
        self._read_tool_positions()
        for merged in self.exchange.accounts.merged:
            self._inventory.merge(merged.number, merged.target)
            if merged.number in self._tool_positions:
                self._tool_positions[merged.target] = self._tool_positions.pop(merged.number)
        self._account_numbers = accounts
        self._inventory.retain(accounts)
        self._tool_positions = {
            n: each for n, each in self._tool_positions.items() if n in accounts
        }

    def _release(self) -> Rows:
        """Return DEPOSIT_REQUEST rows of the soil whose release was requested.

        A machine whose release was requested while it took part may have been dropped since then:
        it keeps what it holds.
        """
        self._read_tool_positions()
        parts = [
            self._deposit_requests(machine_id, self.exchange.release(machine_id))
            for machine_id in self._machines_to_release
            if machine_id in self.exchange.releasable_machines
        ]
        of_ended: dict[int, int] = {}  # volume by number of the account [mm^3]
        for machine_id in self._ended_to_release:
            if machine_id in self.exchange.machines_with_ended_accounts:
                of_ended |= self.exchange.release_ended(machine_id)
        self._machines_to_release = self._ended_to_release = ()
        return join_rows([*parts, self._deposit_requests(ENDED_SESSION, of_ended)], DEPOSIT_REQUEST)

    def _deposit_requests(self, machine_id: int, volumes: Mapping[int, int]) -> Rows:
        """Return DEPOSIT_REQUEST rows of released soil.

        Args:
            machine_id: machine id of the rows.
            volumes: volume by number of the account that held it [mm^3].
        """
        parts = []
        for account, volume in volumes.items():
            rows = split_into_deposit_requests(volume)
            rows["machine_id"] = machine_id
            rows["soil"], rows["moisture"] = self._inventory.majority_soil(account)
            rows["x"], rows["y"], rows["z"] = self._tool_positions.get(account, _ORIGIN)
            parts.append(rows)
            self._inventory.remove(account)
        released = join_rows(parts, DEPOSIT_REQUEST)
        # Not particles; the ids only distinguish the rows.
        released["particle_id"] = np.arange(released.size)
        return released


def split_into_deposit_requests(volume: int) -> Rows:
    """Return DEPOSIT_REQUEST rows with a total volume [mm^3]; all other fields are 0."""
    rows = empty_rows(DEPOSIT_REQUEST, -(-volume // MAX_ROW_VOLUME))
    rows["volume_mm3"] = MAX_ROW_VOLUME
    rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - volume)
    return rows

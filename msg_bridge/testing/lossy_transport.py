"""A transport that drops, duplicates, delays, reorders and forges messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Message, RowChunk
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.soil_exchange import SoilExchange

__all__ = ["LossyTransport"]


class LossyTransport:
    """Transport between soil and machines with repeatable losses.

    Attributes:
        dropped, duplicated, forged: number of messages.
        rejected: number of messages that a receiver rejected.
    """

    def __init__(
        self,
        soil: SoilExchange,
        machines: Sequence[MachineExchange],
        rng: np.random.Generator,
        *,
        drop: float = 0.1,
        duplicate: float = 0.1,
        delay: float = 0.2,
        forge: float = 0.0,
        rows_per_message: int = 16,
    ) -> None:
        """
        Args:
            soil, machines: ends to connect.
            rng: generator for the losses.
            drop, duplicate: probabilities per message and receiver.
            delay: probability per round that a message waits and later ones overtake it.
            forge: probability per chunk and receiver that one with other values in its rows, or
                with rows of later numbers, is sent as well.
            rows_per_message: maximum number of rows of a chunk; longer ones are split, so that
                losses hit parts of them.
        """
        self._soil = soil
        self._machines = machines
        self._rng = rng
        self._drop, self._duplicate, self._delay, self._forge = drop, duplicate, delay, forge
        self._rows = rows_per_message
        self._messages_in_transit: list[tuple[SoilExchange | MachineExchange, Message]] = []
        self.dropped = 0
        self.duplicated = 0
        self.forged = 0
        self.rejected = 0

    def deliver(self) -> int:
        """Collect the sent messages, drop some, and deliver some in random order.

        Returns:
            Number of delivered messages; if 0, call `request_missing` on the ends.
        """
        for machine in self._machines:
            for message in machine.drain_outbox():
                self._take(self._soil, message)
        for message in self._soil.drain_outbox():
            for machine in self._machines:
                self._take(machine, message)
        order = self._rng.permutation(len(self._messages_in_transit))
        late = self._rng.random(len(self._messages_in_transit)) < self._delay
        due = [self._messages_in_transit[i] for i in order if not late[i]]
        self._messages_in_transit = [self._messages_in_transit[i] for i in order if late[i]]
        for end, message in due:
            self._deliver_to(end, message)
        return len(due)

    def _deliver_to(self, end: SoilExchange | MachineExchange, message: Message) -> None:
        try:
            end.receive(message)
        except ExchangeError:
            self.rejected += 1

    def _take(self, end: SoilExchange | MachineExchange, message: Message) -> None:
        for piece in self._pieces(message):
            if self._forge and isinstance(piece, RowChunk) and self._rng.random() < self._forge:
                self.forged += 1
                self._messages_in_transit.append((end, self._forged(piece)))
            fate = self._rng.random()
            if fate < self._drop:
                self.dropped += 1
                continue
            self._messages_in_transit.append((end, piece))
            if fate > 1.0 - self._duplicate:
                self.duplicated += 1
                self._messages_in_transit.append((end, piece))

    def _forged(self, chunk: RowChunk) -> RowChunk:
        """Return a chunk with other values in its rows, at the same numbers or the next."""
        rows = chunk.rows.copy()
        for name in ("volume_mm3", "z", "x0", "fx"):
            if name in (rows.dtype.names or ()):
                rows[name] = self._rng.integers(0, 1000, rows.size)
        rows["seq"] += np.uint32(self._rng.integers(0, 2) * rows.size)
        return replace(chunk, rows=rows)

    def _pieces(self, message: Message) -> list[Message]:
        if not isinstance(message, RowChunk):
            return [message]
        return [
            replace(message, rows=message.rows[i : i + self._rows])
            for i in range(0, message.rows.size, self._rows)
        ]

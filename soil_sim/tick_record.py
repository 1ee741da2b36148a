"""The inputs of one tick of the soil, from which it can be computed again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from msg_bridge.contract.messages import Message, SoilHeader
from msg_bridge.recovery.errors import DivergenceError
from msg_bridge.recovery.packed_messages import PackedMessage, pack_messages, unpack_messages
from soil_sim.endpoint import SoilEndpoint, SoilTickResult

__all__ = ["MachineDrop", "SoilRelease", "SoilTickRecord"]


@dataclass(frozen=True)
class MachineDrop:
    """A joined machine was dropped before the tick.

    Attributes:
        machine_id: its id.
    """

    machine_id: int

    def apply(self, endpoint: SoilEndpoint) -> None:
        """Drop the machine."""
        endpoint.exchange.drop(self.machine_id)


@dataclass(frozen=True)
class SoilRelease:
    """The release of absent soil was requested before the tick."""

    def apply(self, endpoint: SoilEndpoint) -> None:
        """Release the soil that is absent now."""
        endpoint.release_absent_soil()


class SoilTickRecord(NamedTuple):
    """The inputs of one tick.

    Attributes:
        events: drops and releases since the tick before, in order.
        messages: requests to join, and rows and headers of the machines in the tick, packed.
        digests_before: digests of the rows of the tick before, with which this one is computed.
    """

    events: tuple[MachineDrop | SoilRelease, ...]
    messages: list[PackedMessage]
    digests_before: tuple[int, ...]

    @classmethod
    def of(
        cls,
        endpoint: SoilEndpoint,
        events: Sequence[MachineDrop | SoilRelease],
        messages: Sequence[Message],
    ) -> SoilTickRecord:
        """Return the record of the tick that an endpoint is about to compute."""
        digests = _digests(endpoint.exchange.last_header)
        return cls(tuple(events), pack_messages(messages), digests)

    def compute(self, endpoint: SoilEndpoint) -> SoilTickResult:
        """Compute the tick.

        Args:
            endpoint: in the state after the tick before.

        Raises:
            DivergenceError: it is not in that state.
            ExchangeError: a message violates the protocol.
        """
        if _digests(endpoint.exchange.last_header) != self.digests_before:
            raise DivergenceError(endpoint.tick)
        for event in self.events:
            event.apply(endpoint)
        for message in unpack_messages(self.messages):
            endpoint.receive(message)
        done = endpoint.advance(wait=False)
        if done is None:
            raise DivergenceError(endpoint.tick + 1, "its inputs are incomplete")
        return done


def _digests(header: SoilHeader | None) -> tuple[int, ...]:
    """Return the digests of the rows of a tick; empty before tick 0."""
    if header is None:
        return ()
    return tuple(span.digest for span in (header.conversions, header.map_updates, header.forces))

"""The machine's side: a machine and its end of the exchange, one tick at a time.

What a node runs over topics and a world of one process runs directly. Messages go in by
`receive`, come out by `drain_outbox`; `poll` takes the soil's answer, and `step` does the next tick
once the side is ready for it.
"""

from __future__ import annotations

from machine_sim.simulation import MachineSim
from msg_bridge.contract.messages import Message
from msg_bridge.exchange.machine_exchange import JoinState, MachineExchange, TickAnswer

__all__ = ["MachineEndpoint"]


class MachineEndpoint:
    """A machine behind its end of the exchange.

    Attributes:
        sim: the machine, its particles and the ground it feels.
        exchange: numbered streams and the place in the tick.
    """

    def __init__(self, sim: MachineSim, exchange: MachineExchange) -> None:
        self.sim = sim
        self.exchange = exchange
        self._is_synchronized = False

    @property
    def tick(self) -> int:
        """The last tick done; the soil's answers are some behind."""
        return self.exchange.sent_tick

    @property
    def next_tick(self) -> int:
        """Number of the tick that would be done next."""
        return self.exchange.next_tick

    @property
    def is_ready(self) -> bool:
        """Whether the next tick can be done."""
        return self.exchange.join_state is JoinState.READY and self._is_synchronized

    def join(self) -> None:
        """Ask to take part, with what the machine holds.

        Raises:
            ExchangeError: it takes part already.
        """
        self._is_synchronized = False
        self.exchange.join(
            pending_mm3=self.sim.pending_mm3,
            particles_mm3=self.sim.particles.total_volume_mm3,
        )

    def receive(self, message: Message) -> None:
        """Take one message from the soil.

        Raises:
            ExchangeError: it breaks the exchange; nothing was changed.
        """
        self.exchange.receive(message)
        if self.exchange.join_state is JoinState.READY and not self._is_synchronized:
            self._synchronize()

    def drain_outbox(self) -> list[Message]:
        """The messages to carry to the soil, in order; empties the box."""
        return self.exchange.drain_outbox()

    def step(self, *, leave: bool = False) -> None:
        """Do the next tick and send it.

        Args:
            leave: take no part after it; the soil it holds is absent from then on.

        Raises:
            ExchangeError: not ready.
        """
        moved = self.sim.step()
        self.exchange.send(
            moved.sweeps,
            moved.deposit_requests,
            pending_mm3=moved.pending_mm3,
            particles_mm3=moved.particles_mm3,
            leave=leave,
        )

    def poll(self) -> TickAnswer | None:
        """The answer that is waited for, applied to the machine; None until it is here."""
        answer = self.exchange.poll()
        if answer is not None:
            since = self.exchange.num_ticks_in_flight
            self.sim.apply(answer.conversions, answer.map_updates, answer.forces, ticks_ago=since)
        return answer

    def _synchronize(self) -> None:
        """Take over the terrain as it is, and what was answered before a return."""
        keyframe = self.exchange.keyframe
        assert keyframe is not None, "one that takes part has been sent the terrain"
        self.sim.synchronize(keyframe, self.exchange.backlog)
        self._is_synchronized = True

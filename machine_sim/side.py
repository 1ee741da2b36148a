"""The machine's side: a machine and its end of the exchange, one tick at a time.

What a node runs over topics and a world of one process runs directly. Messages go in by
`receive`, come out by `take_outbox`; `poll` takes the soil's answer, and `step` does the next tick
once the side is ready for it.
"""

from __future__ import annotations

from machine_sim.core import MachineSim
from msg_bridge.contract.messages import Message
from msg_bridge.exchange.machine_side import MachineExchange, Phase, TickAnswer

__all__ = ["MachineSide"]


class MachineSide:
    """A machine behind its end of the exchange.

    Attributes:
        sim: the machine, its particles and the ground it feels.
        exchange: numbered streams and the place in the tick.
    """

    def __init__(self, sim: MachineSim, exchange: MachineExchange) -> None:
        self.sim = sim
        self.exchange = exchange
        self._entered = False

    @property
    def tick(self) -> int:
        """The last tick done; the soil's answers are some behind."""
        return self.exchange.sent_tick

    @property
    def next_tick(self) -> int:
        """Number of the tick that would be done next."""
        return self.exchange.next_tick

    @property
    def ready(self) -> bool:
        """Whether the next tick can be done."""
        return self.exchange.phase is Phase.READY and self._entered

    def join(self) -> None:
        """Ask to take part, with what the machine holds.

        Raises:
            ExchangeError: it takes part already.
        """
        self._entered = False
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
        if self.exchange.phase is Phase.READY and not self._entered:
            self._enter()

    def take_outbox(self) -> list[Message]:
        """The messages to carry to the soil, in order; empties the box."""
        return self.exchange.take_outbox()

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
            moved.landed,
            pending_mm3=moved.pending_mm3,
            particles_mm3=moved.particles_mm3,
            leave=leave,
        )

    def poll(self) -> TickAnswer | None:
        """The answer that is waited for, applied to the machine; None until it is here."""
        answer = self.exchange.poll()
        if answer is not None:
            since = self.exchange.unanswered
            self.sim.apply(answer.conversions, answer.changed, answer.forces, ticks_since=since)
        return answer

    def _enter(self) -> None:
        """Take over the terrain as it is, and what was answered before a return."""
        keyframe = self.exchange.keyframe
        assert keyframe is not None, "one that takes part has been sent the terrain"
        self.sim.enter(keyframe, self.exchange.owed)
        self._entered = True

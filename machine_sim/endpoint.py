"""Machine endpoint: machines and their end of the exchange with the soil, one tick at a time.

A node connects it to topics; a simulation in one process connects it directly. Incoming messages
pass through `receive`, outgoing ones through `drain_outbox`; `poll` applies the soil's answer, and
`step` performs the next tick once the endpoint is ready.
"""

from __future__ import annotations

from collections.abc import Iterable

from machine_sim.simulation import MachineSim
from machine_sim.skipped_ticks import book_conversions
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe, Message, RowChunk, SoilHeader
from msg_bridge.contract.rows import CONVERSION, rows_of_machine
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.tick_answer import TickAnswer

__all__ = ["MachineEndpoint"]


class MachineEndpoint:
    """Machines and their end of the exchange.

    Attributes:
        sim: machines, particles and ground.
        exchange: numbered streams, session and ticks in flight.
        num_rejected_welcomes: number of times in succession that the terrain or the backlog of a
            join was invalid.
    """

    def __init__(self, sim: MachineSim, exchange: MachineExchange) -> None:
        self.sim = sim
        self.exchange = exchange
        self._is_synchronized = False
        self.num_rejected_welcomes = 0
        self._has_skipped_ticks = False  # since the last join
        self._is_first_tick = False  # of its session
        self._applied_answers: list[TickAnswer] = []  # since the last tick

    @property
    def tick(self) -> int:
        """Number of the last completed tick; the soil's answers lag behind it."""
        return self.exchange.sent_tick

    @property
    def next_tick(self) -> int:
        """Number of the next tick."""
        return self.exchange.next_tick

    @property
    def is_ready(self) -> bool:
        """Whether the next tick can be performed."""
        return self.exchange.join_state is JoinState.READY and self._is_synchronized

    @property
    def applied_messages(self) -> list[Message]:
        """Messages of the soil that were applied since the last tick: a welcome, or an answer."""
        messages = self.exchange.welcome_messages if self._is_first_tick else []
        return [*messages, *(each for answer in self._applied_answers for each in answer.messages)]

    def join(self) -> None:
        """Request to join the run with the soil that the machines hold.

        Raises:
            ExchangeError: the endpoint has joined already.
        """
        self._is_synchronized = False
        self.exchange.join(
            pending_mm3=self.sim.pending_mm3,
            particles_mm3=self.sim.particles.total_volume_mm3,
        )

    def discard_soil(self) -> int:
        """Remove all soil that the machines hold, to join without soil; return it [mm^3].

        Raises:
            ExchangeError: the endpoint takes part in a run.
        """
        self.exchange.discard_soil()
        self.num_rejected_welcomes = 0
        return self.sim.discard_soil()

    def receive(self, message: Message) -> None:
        """Process one message of the soil.

        Raises:
            ExchangeError: an invalid message; nothing was changed.
        """
        if isinstance(message, Keyframe) and message.run_id == self.exchange.run_id:
            self.sim.ground.check_keyframe(message)
        self.exchange.receive(message)
        if self.exchange.join_state is JoinState.READY and not self._is_synchronized:
            self._synchronize()

    def skip(self, messages: Iterable[Message]) -> None:
        """Apply the volumes of messages of the soil without simulating a tick.

        The session ends; the endpoint can rejoin with the soil that it holds now.

        Args:
            messages: welcome and answers of the soil, in order.

        Raises:
            MachineError: they take more soil than the machines hold.
        """
        self._has_skipped_ticks = True
        for message in messages:
            if isinstance(message, RowChunk) and message.rows.dtype == CONVERSION:
                rows = rows_of_machine(message.rows, self.exchange.machine_id)
                book_conversions(self.sim, rows)
            elif isinstance(message, SoilHeader):
                self.exchange.abandon_session(message.conversions.last)

    def drain_outbox(self) -> list[Message]:
        """Return the messages to the soil in order, and clear them."""
        return self.exchange.drain_outbox()

    def step(self, *, leave: bool = False) -> None:
        """Perform the next tick and send it.

        Args:
            leave: leave the run after it; the soil held is booked as absent.

        Raises:
            ExchangeError: the endpoint is not ready.
        """
        self._is_first_tick = False
        self._applied_answers.clear()
        output = self.sim.step()
        self.exchange.send(
            output.sweeps,
            output.deposit_requests,
            pending_mm3=output.pending_mm3,
            particles_mm3=output.particles_mm3,
            leave=leave,
        )

    def poll(self) -> TickAnswer | None:
        """Apply the next answer of the soil and return it; None until it is complete.

        It is acknowledged after it has been applied: soil in an answer that cannot be applied
        remains credited to the machine at the soil.

        Raises:
            ExchangeError: an invalid answer; nothing was changed, and it is requested again.
        """
        answer = self.exchange.poll()
        if answer is None:
            return None
        rows = (answer.conversions, answer.map_updates, answer.forces)
        # The answered tick itself is in flight until the answer is acknowledged.
        ticks_ago = max(self.exchange.num_ticks_in_flight - 1, 0)
        try:
            self.sim.check_answer(*rows, ticks_ago=ticks_ago)
        except ExchangeError:
            self.exchange.discard_answer()
            raise
        self.sim.apply(*rows, ticks_ago=ticks_ago)
        self._applied_answers.append(answer)
        self.exchange.acknowledge_answer()
        return answer

    def _synchronize(self) -> None:
        """Apply the terrain of the keyframe, and the conversion backlog of a rejoin."""
        keyframe = self.exchange.keyframe
        assert keyframe is not None, "a joined machine has received the terrain"
        backlog = self.exchange.backlog
        try:
            if self._has_skipped_ticks:
                book_conversions(self.sim, backlog)
                backlog = backlog[:0]
            self._has_skipped_ticks = False
            self.sim.synchronize(keyframe, backlog)
        except ExchangeError:
            self.num_rejected_welcomes += 1
            self.exchange.discard_welcome()
            raise
        self.num_rejected_welcomes = 0
        self._is_first_tick = True
        self._applied_answers.clear()
        self._is_synchronized = True

"""Command scheduling in one run: when a command takes effect, and whether a tick waits for one.

Independent of the transport and of clocks: the caller passes the time.
"""

from __future__ import annotations

from collections.abc import Callable

from machine_sim.commands import AppliedCommand
from machine_sim.endpoint import MachineEndpoint
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.timeout_clock import TimeoutClock
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.codec.run_config import RunFacts

__all__ = ["CommandScheduler"]

_MAX_TICKS_AHEAD = 2
"""Minimum number of ticks by which the stamp of a command may be ahead."""


class CommandScheduler:
    """Schedules the commands of one machine in one run.

    Attributes:
        arbiter: arbiter of the machine's commands, which outlives the run.
        last_stamp: stamp of the last stamped command [s]; None without one.
    """

    def __init__(
        self,
        instance: MachineInstance,
        simulated: SimulatedMachine,
        endpoint: MachineEndpoint,
        facts: RunFacts,
    ) -> None:
        """
        Args:
            instance: the machine.
            simulated: the machine in this run.
            endpoint: endpoint that counts the ticks.
            facts: parameters of the run.
        """
        self.arbiter = instance.arbiter
        self._machine, self._endpoint, self._facts = simulated.machine, endpoint, facts
        self._clock = TimeoutClock()
        self._wait_period = instance.params.command_wait_period
        self._delay_ticks = 0 if facts.realtime else instance.params.command_delay
        self.last_stamp: float | None = None
        self._last_answered_tick = -1  # newest tick that a stamped command answers
        self._resumed_tick = -1  # last tick before a restart
        self._unanswered: set[int] = set()  # of the ticks before it

    @property
    def sim_time(self) -> float:
        """Present simulation time [s]."""
        return max(self._endpoint.tick, 0) * self._facts.tick_period

    def command_time(self, wall: float) -> float:
        """Return the time for command timeouts [s]: `TimeoutClock` in real time, else simulated.

        Args:
            wall: a monotonic wall clock [s].
        """
        return self._clock.now(wall) if self._facts.realtime else self.sim_time

    def receive(self, stamp: float, deliver: Callable[[float | None], bool]) -> None:
        """Deliver a stamped command, to take effect now or `command_delay` ticks after its stamp.

        A stamp far ahead comes from another clock or an earlier run; it answers no state.

        Args:
            stamp: simulation time of the state that the command answers [s].
            deliver: passes the command to the arbiter with the simulation time at which it takes
                effect, or took effect when it arrived first [s], None: now; and returns whether it
                was valid.
        """
        tick = round(stamp / self._facts.tick_period)
        ticks_ahead = tick - max(self._endpoint.tick, 0)
        is_answer = ticks_ahead <= max(self._wait_period, _MAX_TICKS_AHEAD)
        self.last_stamp = stamp
        if deliver(self._effect_time(tick) if is_answer else None) and is_answer:
            self._last_answered_tick = max(self._last_answered_tick, tick)
            self._unanswered.discard(tick)

    def _effect_time(self, tick: int) -> float | None:
        """Return when the answer to the state of a tick takes, or took, effect [s]; None: now.

        A state that is repeated while its answer is awaited is answered several times. The effect
        must not depend on how often, nor on when the last of the answers arrives. A stamp of 0 may
        mean that there is none, so that the answer to that state always arrives now.
        """
        effect_tick = tick + self._delay_ticks
        if effect_tick > self._endpoint.tick:
            has_effect_time = self._delay_ticks > 0
        else:
            has_effect_time = tick > 0 and self._awaits_answer_to(tick)
        return effect_tick * self._facts.tick_period if has_effect_time else None

    def _awaits_answer_to(self, tick: int) -> bool:
        """Return whether a tick waits until the state of this one is answered."""
        is_awaited = self._wait_period > 0 and tick >= 0 and tick % self._wait_period == 0
        return is_awaited and not self._facts.realtime

    @property
    def awaited_stamp(self) -> float | None:
        """Simulation time of the state whose answer the next tick waits for [s]: a command with
        this stamp, or a later one, is missing. None if the next tick waits for none.
        """
        answered = self._endpoint.tick - self._delay_ticks
        if not self._awaits_answer_to(answered):
            return None
        if answered <= self._resumed_tick:
            is_missing = answered in self._unanswered
        else:
            is_missing = self._last_answered_tick < answered
        return answered * self._facts.tick_period if is_missing else None

    @property
    def unanswered_ticks(self) -> frozenset[int]:
        """Ticks before a restart whose answers are awaited, now or later, and were lost."""
        first = self._endpoint.tick - self._delay_ticks
        return frozenset(tick for tick in self._unanswered if tick >= first)

    def resume(self) -> None:
        """Continue after a restart: await the answers that have not arrived before it.

        Of a state before the restart its own answer is awaited, not only a later one.
        """
        if self._facts.realtime or not self._wait_period:
            return
        tick, period = self._endpoint.tick, self._facts.tick_period
        arrived = {
            round(time / period) - self._delay_ticks for time in self.arbiter.delayed_effect_times
        }
        self._resumed_tick, self._last_answered_tick = tick, max(arrived, default=-1)
        self._unanswered = {
            answered
            for answered in range(max(tick - self._delay_ticks, 0), tick + 1)
            if self._awaits_answer_to(answered) and answered not in arrived
        }

    def accept_later_answers(self) -> None:
        """Await no answers to the states before a restart if later ones are answered."""
        self._resumed_tick = -1
        self._unanswered.clear()

    @property
    def has_answers(self) -> bool:
        """Whether the states before the last one are answered, if commands are delayed; what is in
        transit when the process dies is lost."""
        if not (self._delay_ticks and self._wait_period):
            return True
        last_tick = self._endpoint.tick - self._wait_period
        return self._last_answered_tick >= last_tick and not self.unanswered_ticks

    @property
    def num_delayed_states(self) -> int:
        """Number of the last states whose answers have not taken effect yet."""
        return self._delay_ticks + 1

    def apply_command(self, wall: float) -> AppliedCommand:
        """Apply the command that takes effect in the tick that begins now, and return it.

        Args:
            wall: monotonic wall clock [s].
        """
        self._clock.tick(wall, self.sim_time)
        applied = self.arbiter.command_at(self.command_time(wall), self._machine.joint_positions)
        self._machine.command(applied.joints, applied.tracks)
        return applied

"""A run of the soil: when a tick is due, which machines it waits for, and which are silent.

Independent of the transport and of the clock: the caller passes the time. In lockstep a tick is due
at once and waits for all machines. In real time it is due by the wall clock and waits for them as
well: on a computer that is too slow, simulation time is slower than the wall clock. With `overload:
skip_ticks` a late machine is waited for until the next tick is due as well, and then the run
continues without it.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import partial

from msg_bridge.contract.messages import MachineHeader, Message
from soil_sim.endpoint import SoilEndpoint, SoilTickResult
from soil_sim.node.contention import Contention
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_journal import RestoredSoil, SoilJournal, TimeControl
from soil_sim.node.tick_scheduler import TickScheduler
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams
from soil_sim.tick_record import MachineDrop, SoilRelease

__all__ = ["MAX_CHECK_INTERVAL", "SilentMachine", "SoilRun"]

_MIN_KEYFRAME_RATE = 20e6
"""Rate at which a slow machine receives and decodes a terrain [B/s]."""

_MAX_LEAD = 1_000_000
"""Number of a run above the present time from which on no earlier soil can have had it."""

MAX_CHECK_INTERVAL = 1.0
"""Wall time between two checks for silent machines [s] above which the soil node stood still."""


@dataclass(frozen=True)
class SilentMachine:
    """A machine whose last message is older than the time-out.

    Attributes:
        machine_id: id of the machine node.
        duration: wall clock time since its last message [s].
        is_dropped: whether the run continues without it from now on.
    """

    machine_id: int
    duration: float
    is_dropped: bool


class SoilRun:
    """The schedule of one run after another.

    Attributes:
        endpoint: soil and its end of the exchange.
        cut_fill: difference of the terrain from the design of the site; None without one.
        params: parameters of the tick.
        journal: where the inputs of the runs are recorded.
        scheduler: schedule in real time.
        paused: whether time stands still; set by `pause`.
        waiting_for_subscribers: whether the first tick must not begin yet.
        num_late_ticks_by_machine: number of late ticks that waited for a machine, by machine id.
    """

    def __init__(
        self,
        site: Site,
        soil_params: SoilParams,
        params: SoilNodeParams,
        *,
        run_id: int,
        journal: SoilJournal | None = None,
        terrain_by_transport: bool = False,
    ) -> None:
        """
        Args:
            site: initial terrain.
            soil_params: parameters of the soil.
            params: parameters of the tick.
            run_id: id of the first run; those after a `reset` are higher.
            journal: where the inputs of the runs are recorded.
            terrain_by_transport: as for `SoilEndpoint`.

        Raises:
            EarthmovingError: soils, layers or design are invalid.
        """
        self.journal = journal or SoilJournal(None)
        self._site = site
        self._soil_params = soil_params
        self._terrain_by_transport = terrain_by_transport
        self.params = params
        self.scheduler = TickScheduler(params.tick_period)
        self.paused = params.paused
        self.waiting_for_subscribers = False
        self.num_late_ticks_by_machine: Counter[int] = Counter()
        self._waited_for: tuple[int, ...] = ()  # machines without which the next tick was due
        self._last_check_time: float | None = None
        self._watch_start = -math.inf  # silence counts from this time on
        self._late_since: dict[int, float] = {}  # by machine id, at every check since then
        self._session_ids: dict[int, int] = {}  # by machine id, at the last check
        self._session_starts: dict[int, float] = {}  # of machines in a further session
        self._requested_tick = 0  # last tick requested while paused
        self._final_tick_pending = False  # a dropped machine needs one more tick
        self._start_run(run_id)

    @property
    def realtime(self) -> bool:
        """Whether ticks follow the wall clock now."""
        return self.params.sync == "realtime" and not self.paused

    @property
    def tick(self) -> int:
        """Number of the last tick; -1 before tick 0, which only admits machines."""
        return self.endpoint.tick

    def on_timer(self, scheduled: float) -> None:
        """Handle the timer of the tick, which was due at `scheduled` [s] of a monotonic clock."""
        if self.realtime and self.endpoint.tick >= 0:
            self.scheduler.on_timer(scheduled)

    def advance(self, now: float) -> SoilTickResult | None:
        """Compute the next tick if it is due and complete; call it until it returns None.

        Args:
            now: monotonic wall clock [s].
        """
        if not self.is_due:
            return None
        began = self.endpoint.tick >= 0
        paced = self.realtime and began
        late = paced and self.params.overload == "skip_ticks" and self.scheduler.is_overdue
        # A requested step is done even without machines.
        free = paced or self.paused or self._final_tick_pending
        alone = began and free and not self.endpoint.exchange.joined
        record = partial(self.journal.record_tick, self.endpoint)
        done = self.endpoint.advance(wait=not (late or alone), record=record)
        if done is not None:
            self._final_tick_pending = False
            self._has_had_machines |= bool(self.endpoint.exchange.joined)
            self._update_cut_fill(done)
        if paced:
            self._record_lateness(now, is_done=done is not None)
        return done

    def pause(self, paused: bool) -> None:
        """Stop time, or let it continue."""
        self.paused = paused
        self.scheduler.stop()
        self.journal.record_time(self.time_control)

    def step(self) -> int:
        """Request one more tick while paused and return its number."""
        self._requested_tick = max(self._requested_tick, self.endpoint.tick) + 1
        self.journal.record_time(self.time_control)
        return self._requested_tick

    def reset(self, *, after: int = 0) -> None:
        """Begin the next run on the initial terrain.

        Args:
            after: number that the one of the run must exceed, as it does that of the present run.
        """
        self.scheduler.stop()
        self._start_run(max(self.endpoint.exchange.run_id, after) + 1)

    def is_number_taken(self, message: Message) -> bool:
        """Return whether a message shows that a run of this or of a higher number has begun before.

        Run ids are times in seconds, and increase by one at each reset: the soil of a process that
        ended a moment ago, or was reset often, may have had that of this run. Its machines would
        take it for theirs, or ignore it.
        """
        run_id = self.endpoint.exchange.run_id
        is_tick = isinstance(message, MachineHeader) and message.is_tick
        # Later the message may be of a machine that took part, and the next run would lose soil.
        is_unused = not self._has_had_machines
        return is_tick and is_unused and run_id <= message.run_id < run_id + _MAX_LEAD

    def resume(self, restored: RestoredSoil) -> None:
        """Continue a run that another process has begun."""
        self.endpoint = restored.endpoint
        self._has_had_machines = True  # perhaps: its messages are answered, whoever sends them
        self.paused, self._requested_tick = restored.time
        self.cut_fill = self._site.cut_fill(self.endpoint.soil.columns.height)

    @property
    def time_control(self) -> TimeControl:
        """Whether time stands still."""
        return TimeControl(self.paused, self._requested_tick)

    def checkpoint_if_due(self) -> None:
        """Write a checkpoint, if it is time for one; call it when what was computed is sent."""
        self.journal.checkpoint_if_due(self.endpoint, self.time_control)

    def release_absent_soil(self) -> tuple[int, ...]:
        """Turn absent soil into terrain; see `SoilEndpoint.release_absent_soil`."""
        self.journal.add_event(SoilRelease())
        return self.endpoint.release_absent_soil()

    def _drop(self, machine_id: int) -> None:
        self.journal.add_event(MachineDrop(machine_id))
        self.endpoint.exchange.drop(machine_id)

    def check_silent_machines(
        self, now: float, last_message_times: dict[int, float]
    ) -> list[SilentMachine]:
        """Find the silent machines, and drop those that the run does not wait for.

        A machine is silent if its part of the next tick is late and its last message is older than
        `machine_timeout`. In real time each of them is dropped; in lockstep only one as which
        another session requests to join now (see `CONTENTION_TIMEOUT`), for example that of a node
        that was restarted: the run waits for the others. The soil of a dropped machine is absent.
        Time in which the soil node itself stood still is no silence of a machine: after such a
        stall each machine has the whole `machine_timeout` to send.

        Args:
            now: monotonic wall clock [s].
            last_message_times: time of the last message by machine id, same clock.

        Returns:
            The silent machines, the dropped ones among them.
        """
        if self._last_check_time is not None and now - self._last_check_time > MAX_CHECK_INTERVAL:
            self._watch_start = max(self._watch_start, now)
        self._last_check_time = now
        self._contention.update(now, self.endpoint.exchange.contending_requests)
        if self.endpoint.tick < 0 or (self.paused and self.endpoint.tick >= self._requested_tick):
            return []
        silent = []
        late = self.endpoint.exchange.late
        # A machine that ends as soon as it has joined never sends a message in its session.
        self._late_since = {n: self._late_since.get(n, now) for n in late}
        self._update_sessions(now)
        for machine_id in late:
            last = last_message_times.get(machine_id, self._late_since.get(machine_id, now))
            begin = self._session_starts.get(machine_id, -math.inf)  # `last` may be before it
            duration = now - max(last, begin, self._watch_start)
            if duration >= self.params.machine_timeout:
                is_dropped = self.realtime or self._contention.is_contended(machine_id, now)
                if is_dropped:
                    self._drop(machine_id)
                silent.append(SilentMachine(machine_id, duration, is_dropped=is_dropped))
        return silent

    def expect_keyframe(self, now: float, num_bytes: int) -> None:
        """Count no silence while machines receive and decode a terrain that is sent now.

        Args:
            now: monotonic wall clock [s].
            num_bytes: size of its message.
        """
        self._watch_start = max(self._watch_start, now + num_bytes / _MIN_KEYFRAME_RATE)

    def _update_sessions(self, now: float) -> None:
        """Record which machines are in another session than at the last check."""
        for machine_id, session_id in self.endpoint.exchange.session_ids.items():
            if self._session_ids.get(machine_id, session_id) != session_id:
                self._session_starts[machine_id] = now
                self._late_since.pop(machine_id, None)
            self._session_ids[machine_id] = session_id

    def drop_silent_machines(
        self, now: float, last_message_times: dict[int, float]
    ) -> tuple[int, ...]:
        """Drop the silent machines, in lockstep too; their soil is booked as absent.

        One more tick is done even if no machine is left, so that a machine that is alive after all
        receives it.

        Args:
            now, last_message_times: as for `check_silent_machines`.

        Returns:
            Ids of the dropped machines.
        """
        silent = self.check_silent_machines(now, last_message_times)
        dropped = tuple(each.machine_id for each in silent)
        for machine_id in dropped:
            if machine_id in self.endpoint.exchange.joined:
                self._drop(machine_id)
                self._final_tick_pending = True
        return dropped

    def _record_lateness(self, now: float, *, is_done: bool) -> None:
        """Record which machines a due tick waits for, and whether it was late in the end."""
        if not is_done:
            self._waited_for = self.endpoint.exchange.late
            return
        if self.scheduler.mark_done(now):
            self.num_late_ticks_by_machine.update(self._waited_for)
        self._waited_for = ()

    def _start_run(self, run_id: int) -> None:
        soil = self._site.make_soil(self._soil_params)
        self.cut_fill = self._site.cut_fill(soil.columns.height)
        self.endpoint = SoilEndpoint(
            soil,
            expected=self.params.expected_machines,
            admit_others=self.params.admit_other_machines,
            max_tool_displacement=self.params.max_tool_speed * self.params.tick_period,
            run_id=run_id,
            terrain_by_transport=self._terrain_by_transport,
        )
        self._contention = Contention()
        self._has_had_machines = False  # whether a machine has taken part in this run
        self._requested_tick = 0
        self._final_tick_pending = False

    def _update_cut_fill(self, done: SoilTickResult) -> None:
        """Update the columns that a tick changed."""
        if self.cut_fill is not None:
            rows, cols = done.step.map_updates["row"], done.step.map_updates["col"]
            self.cut_fill.update(rows, cols, self.endpoint.soil.columns.height[rows, cols])

    @property
    def is_due(self) -> bool:
        """Whether the next tick is to be computed as soon as it is complete."""
        if self.waiting_for_subscribers:
            return False
        if self.endpoint.tick < 0:  # tick 0 moves nothing: it is due even while paused
            return True
        if self.paused:
            return self.endpoint.tick < self._requested_tick
        return self.params.sync == "lockstep" or self.scheduler.is_due

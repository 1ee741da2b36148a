"""A run of the soil: when a tick is due, whom it waits for, and who has been silent too long.

Knows no messages' carrier and reads no clock: the caller says what time it is. In lockstep a tick
is due at once and waits for all machines. In real time it is due by the wall clock; a machine that
is late is waited for until the next tick is due, too, and then the soil goes on without it.
"""

from __future__ import annotations

from dataclasses import dataclass

from soil_sim.endpoint import SoilEndpoint, SoilTickResult
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.tick_scheduler import TickScheduler
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams

__all__ = ["SilentMachine", "SoilRun"]


@dataclass(frozen=True)
class SilentMachine:
    """A machine that the soil has heard nothing of for too long.

    Attributes:
        source: which.
        seconds: for how long [s, wall].
        dropped: whether the soil goes on without it from now on.
    """

    machine_id: int
    seconds: float
    dropped: bool


class SoilRun:
    """The soil in time.

    Attributes:
        side: the soil and its end of the exchange.
        cut_fill: how far the ground is from the site's design; None without one.
        params: the tick, and whom it waits for.
        pace: the schedule in real time.
        paused: whether time stands still; change it by `pause`.
        held: whether even the first tick must not come yet.
    """

    def __init__(
        self, site: Site, soil_params: SoilParams, params: SoilNodeParams, *, run_id: int
    ) -> None:
        """
        Args:
            site: what it begins with.
            soil_params: what the terrain is made of.
            params: the tick, and whom it waits for.
            epoch: number of the run; `reset` raises it.

        Raises:
            EarthmovingError: soils, layers or a design that cannot be.
        """
        self._site = site
        self._soil_params = soil_params
        self.params = params
        self.scheduler = TickScheduler(params.tick_period)
        self.paused = params.paused
        self.waiting_for_subscribers = False
        self._requested_tick = 0  # the last tick asked for while paused
        self._final_tick_pending = False  # whether a tick is owed to those who were given up
        self._start_run(run_id)

    @property
    def realtime(self) -> bool:
        """Whether ticks follow the wall clock now."""
        return self.params.sync == "realtime" and not self.paused

    @property
    def tick(self) -> int:
        """The last tick done; -1 before the welcome, which is tick 0."""
        return self.endpoint.tick

    def on_timer(self, scheduled: float) -> None:
        """A timer with the tick's period fires; it was to at `scheduled` [s], a monotonic clock."""
        if self.realtime and self.endpoint.tick >= 0:
            self.scheduler.on_timer(scheduled)

    def advance(self, now: float) -> SoilTickResult | None:
        """The next tick, if it is due and its parts are here; to be called until it gives None.

        Args:
            now: a monotonic wall clock [s].
        """
        if not self._is_due:
            return None
        began = self.endpoint.tick >= 0
        paced = self.realtime and began
        late = paced and self.scheduler.is_overdue
        # A step that is asked for is done even if nobody takes part.
        free = paced or self.paused or self._final_tick_pending
        alone = began and free and not self.endpoint.exchange.joined
        done = self.endpoint.advance(wait=not (late or alone))
        if done is not None:
            self._final_tick_pending = False
            self._update_cut_fill(done)
        if paced and done is not None:
            self.scheduler.mark_done(now)
        return done

    def pause(self, paused: bool) -> None:
        """Let time stand still, or go on."""
        self.paused = paused
        self.scheduler.stop()

    def step(self) -> int:
        """Ask for one more tick while paused; returns its number."""
        self._requested_tick = max(self._requested_tick, self.endpoint.tick) + 1
        return self._requested_tick

    def reset(self) -> None:
        """Begin anew on the untouched site, as the next epoch."""
        self.scheduler.stop()
        self._start_run(self.endpoint.exchange.run_id + 1)

    def find_silent_machines(
        self, now: float, last_message_times: dict[int, float]
    ) -> list[SilentMachine]:
        """Machines waited for that have been silent for longer than they may be.

        In real time they are dropped.

        Args:
            now: a monotonic wall clock [s].
            heard: when each source was last heard, by the same clock.
        """
        if self.endpoint.tick < 0 or (self.paused and self.endpoint.tick >= self._requested_tick):
            return []
        found = []
        for machine_id in self.endpoint.exchange.late:
            seconds = now - last_message_times.get(machine_id, now)
            if seconds >= self.params.machine_timeout:
                if self.realtime:
                    self.endpoint.exchange.drop(machine_id)
                found.append(SilentMachine(machine_id, seconds, dropped=self.realtime))
        return found

    def drop_silent_machines(
        self, now: float, last_message_times: dict[int, float]
    ) -> tuple[int, ...]:
        """Go on without machines that have been waited for too long; what they hold is absent.

        A tick is done even if nobody is left, so that one that lives after all learns of it.

        Args:
            now, heard: as for `find_silent_machines`.

        Returns:
            Which.
        """
        given_up = [
            silence.machine_id for silence in self.find_silent_machines(now, last_message_times)
        ]
        for machine_id in given_up:
            if machine_id in self.endpoint.exchange.joined:
                self.endpoint.exchange.drop(machine_id)
                self._final_tick_pending = True
        return tuple(given_up)

    def _start_run(self, run_id: int) -> None:
        soil = self._site.make_soil(self._soil_params)
        self.cut_fill = self._site.cut_fill(soil.columns.height)
        self.endpoint = SoilEndpoint(soil, expected=self.params.expected_machines, run_id=run_id)
        self._requested_tick = 0
        self._final_tick_pending = False

    def _update_cut_fill(self, done: SoilTickResult) -> None:
        """Follow the columns that a tick changed, and only those."""
        if self.cut_fill is not None:
            rows, cols = done.step.map_updates["row"], done.step.map_updates["col"]
            self.cut_fill.update(rows, cols, self.endpoint.soil.columns.height[rows, cols])

    @property
    def _is_due(self) -> bool:
        if self.waiting_for_subscribers:
            return False
        if self.endpoint.tick < 0:  # the welcome moves nothing: it comes even while paused
            return True
        if self.paused:
            return self.endpoint.tick < self._requested_tick
        return self.params.sync == "lockstep" or self.scheduler.is_due

"""A run of the soil: when a tick is due, whom it waits for, and who has been silent too long.

Knows no messages' carrier and reads no clock: the caller says what time it is. In lockstep a tick
is due at once and waits for all machines. In real time it is due by the wall clock; a machine that
is late is waited for until the next tick is due, too, and then the soil goes on without it.
"""

from __future__ import annotations

from dataclasses import dataclass

from soil_sim.node_params import SoilNodeParams
from soil_sim.pace import Pace
from soil_sim.params import SoilParams
from soil_sim.side import SoilSide, SoilTick
from soil_sim.site import Site

__all__ = ["Silence", "SoilRun"]


@dataclass(frozen=True)
class Silence:
    """A machine that the soil has heard nothing of for too long.

    Attributes:
        source: which.
        seconds: for how long [s, wall].
        dropped: whether the soil goes on without it from now on.
    """

    source: int
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
        self, site: Site, soil_params: SoilParams, params: SoilNodeParams, *, epoch: int
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
        self.pace = Pace(params.tick)
        self.paused = params.paused
        self.held = False
        self._wanted = 0  # the last tick asked for while paused
        self._parting = False  # whether a tick is owed to those who were given up
        self._begin(epoch)

    @property
    def realtime(self) -> bool:
        """Whether ticks follow the wall clock now."""
        return self.params.sync == "realtime" and not self.paused

    @property
    def tick(self) -> int:
        """The last tick done; -1 before the welcome, which is tick 0."""
        return self.side.tick

    def on_time(self, scheduled: float) -> None:
        """A timer with the tick's period fires; it was to at `scheduled` [s], a monotonic clock."""
        if self.realtime and self.side.tick >= 0:
            self.pace.on_time(scheduled)

    def advance(self, now: float) -> SoilTick | None:
        """The next tick, if it is due and its parts are here; to be called until it gives None.

        Args:
            now: a monotonic wall clock [s].
        """
        if not self._due:
            return None
        began = self.side.tick >= 0
        paced = self.realtime and began
        late = paced and self.pace.overdue
        # A step that is asked for is done even if nobody takes part.
        free = paced or self.paused or self._parting
        alone = began and free and not self.side.exchange.joined
        done = self.side.advance(wait=not (late or alone))
        if done is not None:
            self._parting = False
            self._compare(done)
        if paced and done is not None:
            self.pace.done(now)
        return done

    def pause(self, paused: bool) -> None:
        """Let time stand still, or go on."""
        self.paused = paused
        self.pace.stop()

    def step(self) -> int:
        """Ask for one more tick while paused; returns its number."""
        self._wanted = max(self._wanted, self.side.tick) + 1
        return self._wanted

    def reset(self) -> None:
        """Begin anew on the untouched site, as the next epoch."""
        self.pace.stop()
        self._begin(self.side.exchange.epoch + 1)

    def silent(self, now: float, heard: dict[int, float]) -> list[Silence]:
        """Machines waited for that have been silent for longer than they may be.

        In real time they are dropped.

        Args:
            now: a monotonic wall clock [s].
            heard: when each source was last heard, by the same clock.
        """
        if self.side.tick < 0 or (self.paused and self.side.tick >= self._wanted):
            return []
        found = []
        for source in self.side.exchange.late:
            seconds = now - heard.get(source, now)
            if seconds >= self.params.machine_timeout:
                if self.realtime:
                    self.side.exchange.drop(source)
                found.append(Silence(source, seconds, dropped=self.realtime))
        return found

    def give_up_silent(self, now: float, heard: dict[int, float]) -> tuple[int, ...]:
        """Go on without machines that have been waited for too long; what they hold is absent.

        A tick is done even if nobody is left, so that one that lives after all learns of it.

        Args:
            now, heard: as for `silent`.

        Returns:
            Which.
        """
        given_up = [silence.source for silence in self.silent(now, heard)]
        for source in given_up:
            if source in self.side.exchange.joined:
                self.side.exchange.drop(source)
                self._parting = True
        return tuple(given_up)

    def _begin(self, epoch: int) -> None:
        soil = self._site.make_soil(self._soil_params)
        self.cut_fill = self._site.cut_fill(soil.columns.height)
        self.side = SoilSide(soil, expected=self.params.expected_machines, epoch=epoch)
        self._wanted = 0
        self._parting = False

    def _compare(self, done: SoilTick) -> None:
        """Follow the columns that a tick changed, and only those."""
        if self.cut_fill is not None:
            rows, cols = done.step.changed["row"], done.step.changed["col"]
            self.cut_fill.update(rows, cols, self.side.soil.columns.height[rows, cols])

    @property
    def _due(self) -> bool:
        if self.held:
            return False
        if self.side.tick < 0:  # the welcome moves nothing: it comes even while paused
            return True
        if self.paused:
            return self.side.tick < self._wanted
        return self.params.sync == "lockstep" or self.pace.due

"""BagPlayer: plays a bag into its scene, in a thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError
from viewer.scene.scene import Scene
from viewer.server.backend import Timeline
from viewer.sources.bag_scene import BagScene

__all__ = ["BagPlayer"]

_STEP = 0.02
"""Wall time between two steps of the player [s]."""

_MAX_STEP_TIME = 0.1
"""Wall time that a step may take [s]; then the position falls back to what is decoded."""

_BATCH = 200
"""Number of messages that are decoded between two looks at the clock."""

_MAX_PLAYED = 4.0
"""Simulated time [s] beyond which a step restores the state instead of playing the messages."""


class BagPlayer:
    """A player of one bag. Requests come from another thread and return at once."""

    def __init__(
        self,
        path: Path,
        *,
        namespace: str | None = None,
        on_close: Callable[[], None] = lambda: None,
    ) -> None:
        """Index the bag and start playing it.

        Args:
            path: the bag.
            namespace: of the simulation in it; None: the only one.
            on_close: called when the player has ended.

        Raises:
            EarthmovingError: the bag cannot be read.
        """
        self._bag = BagScene(path, namespace=namespace)
        self._on_close = on_close
        self._condition = threading.Condition()
        self._time = 0.0
        self._rate = 1.0
        self._paused = False
        self._sought: float | None = 0.0
        self._closed = False
        self._failure = ""
        self._thread = threading.Thread(target=self._run, name="bag_player", daemon=True)
        self._thread.start()

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self._bag.scene

    def play(self) -> None:
        """Continue; at the end, begin again."""
        with self._condition:
            self._paused = False
            if self._time >= self._bag.timeline.duration:
                self._sought = 0.0
            self._condition.notify()

    def pause(self) -> None:
        """Stand still."""
        with self._condition:
            self._paused = True

    def seek(self, time: float) -> None:
        """Go to a time [s] from the start."""
        with self._condition:
            self._sought = min(max(time, 0.0), self._bag.timeline.duration)
            self._condition.notify()

    def set_rate(self, rate: float) -> None:
        """Set the rate, 1 is real time."""
        with self._condition:
            self._rate = rate

    def timeline(self) -> Timeline:
        """Return the present position."""
        with self._condition:
            now = self._time if self._sought is None else self._sought
            return Timeline(0.0, self._bag.timeline.duration, now, self._rate, self._paused)

    def failure(self) -> str:
        """Return why the player has ended; empty while it runs."""
        return self._failure

    def close(self) -> None:
        """End the player; it does not wait."""
        with self._condition:
            self._closed = True
            self._condition.notify()

    def _run(self) -> None:
        try:
            last = time.monotonic()
            while True:
                with self._condition:
                    if self._sought is None and not self._closed:
                        self._condition.wait(_STEP)
                    if self._closed:
                        return
                    sought, self._sought = self._sought, None
                    now = time.monotonic()
                    elapsed = 0.0 if self._paused else self._rate * (now - last)
                    target = self._time + elapsed if sought is None else sought
                    if sought is not None:
                        self._time = sought
                last = now
                self._go_to(target, is_sought=sought is not None)
        except EarthmovingError as error:
            self._failure = str(error)
        finally:
            self._bag.close()
            self._on_close()

    def _go_to(self, target: float, *, is_sought: bool) -> None:
        """Bring the scene to a position [s], or as near to it as time allows."""
        bag, duration = self._bag, self._bag.timeline.duration
        number = bag.number_at(target)
        deadline = time.monotonic() + _MAX_STEP_TIME
        reached = target
        if is_sought or target - self._time > _MAX_PLAYED:
            bag.restore(number)
        else:
            while bag.position < number:
                bag.advance(min(bag.position + _BATCH, number))
                if time.monotonic() > deadline and bag.position < number:
                    reached = max(self._time, bag.reached())
                    break
        with self._condition:
            self._time = min(reached, duration)
            if reached >= duration:
                self._paused = True

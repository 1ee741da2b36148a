"""Times of a film's frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from viewer.rendering.errors import RenderError

__all__ = ["FrameTimes"]

_RATES = (1.0, 120.0)
_SPEEDS = (0.01, 1000.0)
_MAX_FRAMES = 200_000


@dataclass(frozen=True)
class FrameTimes:
    """Simulation times that a film shows.

    Attributes:
        start: of the first frame [s].
        end: of the last frame at the latest [s].
        rate: frames per second of the film.
        speed: simulated seconds per second of the film.
    """

    start: float
    end: float
    rate: float = 25.0
    speed: float = 1.0

    def __post_init__(self) -> None:
        """Validate the values.

        Raises:
            RenderError: a value is out of range, or the film would be too long.
        """
        for name, value, (low, high) in (
            ("frame rate", self.rate, _RATES),
            ("speed", self.speed, _SPEEDS),
        ):
            if not low <= value <= high:
                raise RenderError(f"the {name} must be {low:g} to {high:g}, not {value:g}")
        if not (math.isfinite(self.start) and math.isfinite(self.end)):
            raise RenderError(f"a film needs a start and an end, not {self.start} and {self.end} s")
        if self.end < self.start:
            raise RenderError(
                f"the film would end at {self.end:.2f} s, before its start at {self.start:.2f} s"
            )
        if len(self) > _MAX_FRAMES:
            raise RenderError(
                f"the film would have {len(self):,} frames, more than {_MAX_FRAMES:,}; give a"
                " higher speed, a lower frame rate or a shorter time"
            )

    def __len__(self) -> int:
        """Return the number of frames."""
        return int((self.end - self.start) * self.rate / self.speed + 1e-6) + 1

    def __iter__(self) -> Iterator[float]:
        """Yield the time of each frame [s]."""
        for number in range(len(self)):
            yield self.start + number * self.speed / self.rate

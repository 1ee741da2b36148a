"""FilmProgress: the progress of a film on the terminal."""

from __future__ import annotations

import sys
import time
from pathlib import Path

__all__ = ["FilmProgress"]

_BAR_WIDTH = 30
_LINE_INTERVAL = 15.0
"""Wall time between lines where the output is no terminal [s]."""


class FilmProgress:
    """Prints a bar with the remaining time, or lines where the output is no terminal."""

    def __init__(self, count: int, output: Path) -> None:
        """
        Args:
            count: number of frames.
            output: what is written.
        """
        self._count, self._output = count, output
        self._is_terminal = sys.stderr.isatty()
        self._start = self._last_line = time.monotonic()

    def show(self, number: int) -> None:
        """Show that a number of frames is done."""
        now = time.monotonic()
        elapsed = now - self._start
        is_done = number == self._count
        if self._is_terminal:
            filled = round(_BAR_WIDTH * number / self._count)
            bar = "█" * filled + "░" * (_BAR_WIDTH - filled)
            line = f"  {bar} {number}/{self._count}  {self._rest(number, elapsed)}"
            print(f"\r{line:<78}", end="\n" if is_done else "", file=sys.stderr, flush=True)
        elif now - self._last_line > _LINE_INTERVAL and not is_done:
            self._last_line = now
            print(
                f"  frame {number}/{self._count}, {self._rest(number, elapsed)}",
                file=sys.stderr,
                flush=True,
            )
        if is_done:
            frames = "1 picture" if self._count == 1 else f"{self._count} frames"
            print(f"{self._output}: {frames} in {elapsed:.0f} s")

    def _rest(self, number: int, elapsed: float) -> str:
        seconds = elapsed / number * (self._count - number)
        minutes = f"{int(seconds // 60)} min " if seconds >= 60.0 else ""
        return f"{number / max(elapsed, 1e-9):.2f} frames/s, {minutes}{seconds % 60.0:.0f} s left"

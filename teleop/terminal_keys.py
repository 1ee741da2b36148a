"""Keys that are held, from the bytes that a terminal sends.

A terminal with the keyboard protocol of kitty reports each press and each release. A key is held
until its release, but a release that is lost on a stalled connection would leave the machine
moving. So the terminal is asked again and again while keys are held, and all keys count as released
when nothing has come from it for a while: neither an answer nor a repetition, which not all
terminals send, and only for the last pressed key. A key that was released so, or because the
terminal lost the focus, counts again when it is pressed again; its repetitions are ignored.

Any other terminal sends a byte when a key is pressed, and after a delay repeats it, for the last
pressed key only: a key then counts as held for a while after each byte.

Source: "Comprehensive keyboard handling in terminals", the documentation of kitty.
"""

from __future__ import annotations

import re
import sys

__all__ = ["END_SEQUENCE", "FOCUS_LOST", "QUERY", "QUERY_PERIOD", "START_SEQUENCE", "TerminalKeys"]

QUERY = b"\x1b[?u"
"""Asks whether releases are reported; a terminal that reports them answers."""

QUERY_PERIOD = 0.1
"""Time between two queries while keys are held [s]."""

START_SEQUENCE = b"\x1b[>11u" + QUERY + b"\x1b[?1004h"
"""Requests releases of all keys (flags 1, 2 and 8), asks whether they come, and requests reports of
a lost focus."""

END_SEQUENCE = b"\x1b[?1004l\x1b[<u"
"""Undoes `START_SEQUENCE`."""

FOCUS_LOST = b"\x1b[O"
"""Report of a lost focus: all keys are released."""

_FIRST_HOLD_TIME = 0.5
"""Time for which a press counts [s], until the terminal begins to repeat it."""

_REPEAT_HOLD_TIME = 0.2
"""Time for which a repetition counts [s]; they follow one another at 20 to 40 Hz."""

_MAX_SILENCE = 0.5
"""Time without a byte of a terminal that reports releases after which no key is held [s]: several
queries, and the delay of a slow connection."""

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_CONTROL_MODIFIER = 4
_INTERRUPT = "\x03"
"""Character of Ctrl-C."""

_SEQUENCE = re.compile(rb"\x1b(?:\[([?<>=]?)([0-9:;]{0,40})([A-Za-z~])|O([A-D]))")
_INCOMPLETE = re.compile(rb"\x1b(?:\[[?<>=]?[0-9:;]{0,40}|O)?\Z")


class TerminalKeys:
    """Keys of a terminal.

    Attributes:
        has_releases: whether the terminal reports releases.
    """

    def __init__(self) -> None:
        self.has_releases = False
        self._until: dict[str, float] = {}  # end of the time for which each key counts as held
        self._unread = b""
        self._last_byte = -float("inf")

    def held(self, now: float) -> set[str]:
        """Return the keys that are held.

        Args:
            now: a monotonic clock [s].
        """
        if self.has_releases and now - self._last_byte > _MAX_SILENCE:
            self.release()
        return {key for key, until in self._until.items() if now < until}

    def release(self) -> None:
        """Count all keys as released, for example when the terminal has lost the focus."""
        self._until.clear()

    def feed(self, data: bytes, now: float) -> list[str]:
        """Read bytes, and return the keys that were pressed, in their order.

        Letters are in lower case; arrows are "up", "down", "left" and "right"; Ctrl-C is "q".

        Args:
            data: bytes of the terminal; a sequence may continue in the next call.
            now: a monotonic clock [s].
        """
        self.held(now)  # releases the keys if the terminal was silent until now
        if data:
            self._last_byte = now
        data = self._unread + data
        pressed: list[str] = []
        position = 0
        while position < len(data):
            match = _SEQUENCE.match(data, position)
            if match is not None:
                pressed += self._read_sequence(match, now)
                position = match.end()
            elif _INCOMPLETE.match(data, position):
                break
            else:
                pressed += self._press(chr(data[position]).lower(), now)
                position += 1
        self._unread = data[position:]
        return pressed

    def _read_sequence(self, match: re.Match[bytes], now: float) -> list[str]:
        private, numbers, final, arrow = (part.decode() if part else "" for part in match.groups())
        if arrow:
            return self._press(_ARROWS[arrow], now)
        if private:
            self.has_releases |= final == "u"  # the answer to the question in START_SEQUENCE
            return []
        if final == "O":
            self.release()
            return []
        code, _, rest = numbers.partition(";")
        code = code.partition(":")[0]  # without the key's codes in other layouts
        modifiers, _, event = rest.partition(";")[0].partition(":")
        if final in _ARROWS:
            key = _ARROWS[final]
        elif final == "u" and code and int(code) <= sys.maxunicode:
            key = chr(int(code)).lower()
            if modifiers.isdigit() and (int(modifiers) - 1) & _CONTROL_MODIFIER:
                key = _INTERRUPT if key == "c" else ""
        else:
            return []
        if event == "3":
            self._until.pop(key, None)
            return []
        return self._press(key, now, is_repeated=event == "2") if key else []

    def _press(self, key: str, now: float, *, is_repeated: bool = False) -> list[str]:
        """Mark a key as held, and return it unless it was held before."""
        if key == _INTERRUPT:
            return ["q"]
        was_held = self._until.get(key, now) > now
        if is_repeated and not was_held:
            return []
        hold_time = _REPEAT_HOLD_TIME if was_held else _FIRST_HOLD_TIME
        self._until[key] = float("inf") if self.has_releases else now + hold_time
        return [] if was_held else [key]

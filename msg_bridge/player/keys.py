"""Keys of a terminal that control the player, each read at once and without echo."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from enum import Enum
from types import TracebackType
from typing import Any

__all__ = ["HELP", "Key", "KeyReader", "parse_keys"]

HELP = (
    "space pause, \N{LEFTWARDS ARROW} \N{RIGHTWARDS ARROW} 10 s,"
    " \N{UPWARDS ARROW} \N{DOWNWARDS ARROW} rate, s step, q quit"
)


class Key(Enum):
    """What a key does."""

    PAUSE = " "
    STEP = "s"
    QUIT = "q"
    BACK = "\x1b[D"
    FORWARD = "\x1b[C"
    FASTER = "\x1b[A"
    SLOWER = "\x1b[B"


_ESCAPE_LENGTH = 3
_MAX_READ = 256


class KeyReader:
    """Context manager that reads keys; without a terminal there are none.

    Attributes:
        is_terminal: whether input and output are a terminal.
    """

    def __init__(self) -> None:
        self.is_terminal = sys.stdin.isatty() and sys.stdout.isatty()
        self._saved: list[Any] | None = None

    def __enter__(self) -> KeyReader:
        if self.is_terminal:
            self._saved = termios.tcgetattr(sys.stdin.fileno())
            tty.setcbreak(sys.stdin.fileno())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._saved is not None:
            termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, self._saved)

    def read(self) -> list[Key]:
        """Return the keys pressed since the last call; others are ignored."""
        if not self.is_terminal or not select.select([sys.stdin], [], [], 0.0)[0]:
            return []
        return parse_keys(os.read(sys.stdin.fileno(), _MAX_READ).decode(errors="replace"))


def parse_keys(text: str) -> list[Key]:
    """Return the keys that a terminal reports as a text."""
    keys, known = [], {key.value: key for key in Key}
    while text:
        length = _ESCAPE_LENGTH if text.startswith("\x1b[") else 1
        key = known.get(text[:length])
        if key is not None:
            keys.append(key)
        text = text[length:]
    return keys

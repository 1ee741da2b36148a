"""The terminal in the mode that teleoperation needs: full screen, each key at once, no echo."""

from __future__ import annotations

import curses
import os
import select
import signal
import sys
import termios
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType

from msg_bridge.contract.errors import EarthmovingError
from teleop.terminal_keys import END_SEQUENCE, FOCUS_LOST, START_SEQUENCE

__all__ = ["Terminal", "TerminalError"]

_MAX_READ = 4096


class TerminalError(EarthmovingError):
    """Input and output are no terminal, or its type is unknown."""


class Terminal:
    """Context manager that shows lines and reads bytes; restores the terminal when it ends.

    While the program is suspended, as by Ctrl-Z, the terminal is as before it started.
    """

    def __init__(self) -> None:
        """
        Raises:
            TerminalError: there is no terminal.
        """
        if not (sys.stdin.isatty() and sys.stdout.isatty()):
            raise TerminalError(
                "input and output are no terminal; run it in one, or publish sensor_msgs/Joy on"
                " <machine>/joy from a program"
            )
        try:
            curses.setupterm()
        except curses.error as error:
            raise TerminalError(
                f"the terminal has no description ({error}); set TERM, for example to xterm"
            ) from error

    def __enter__(self) -> Terminal:
        self._window = curses.initscr()
        curses.noecho()
        curses.cbreak()
        self._disable_flow_control()
        with suppress(curses.error):  # a terminal that cannot hide its cursor
            curses.curs_set(0)
        self._window.refresh()
        self.write(START_SEQUENCE)
        self._is_open, self._unread = True, b""
        signal.signal(signal.SIGTSTP, self._suspend)
        signal.signal(signal.SIGCONT, self._resume)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for number in (signal.SIGTSTP, signal.SIGCONT):
            signal.signal(number, signal.SIG_DFL)
        self._close()

    def _close(self) -> None:
        self.write(END_SEQUENCE)
        curses.endwin()
        self._is_open = False

    def _suspend(self, *_: object) -> None:
        """Restore the terminal, then stop: curses would not undo `START_SEQUENCE`."""
        self._close()
        os.kill(os.getpid(), signal.SIGSTOP)

    def _resume(self, *_: object) -> None:
        """Set the mode again, also after a SIGSTOP, which came without notice."""
        curses.reset_prog_mode()
        self._window.redrawwin()
        self._window.refresh()
        if not self._is_open:
            self.write(START_SEQUENCE)
            self._is_open = True
        self._unread = FOCUS_LOST  # what was held may have been released in the meantime

    def read(self) -> bytes | None:
        """Return the bytes that have arrived, without waiting; None if the terminal is closed."""
        data, self._unread = self._unread, b""
        descriptor = sys.stdin.fileno()
        while select.select([descriptor], [], [], 0.0)[0]:
            try:
                part = os.read(descriptor, _MAX_READ)
            except OSError:
                return None
            if not part:
                return None
            data += part
        return data

    def show(self, lines: Sequence[str]) -> None:
        """Replace what is shown; lines and columns that do not fit are cut off."""
        columns, rows = os.get_terminal_size(sys.stdout.fileno())
        if rows and columns and (rows, columns) != self._window.getmaxyx():
            curses.resizeterm(rows, columns)
        height, width = self._window.getmaxyx()
        self._window.erase()
        for row, line in enumerate(lines[:height]):
            with suppress(curses.error):  # the last cell cannot be written without scrolling
                self._window.addnstr(row, 0, line, width)
        self._window.refresh()

    def _disable_flow_control(self) -> None:
        """Read Ctrl-S and Ctrl-Q as keys: Ctrl-S would stop the output, and this program with it.

        `curses.endwin` restores the mode from before.
        """
        descriptor = sys.stdin.fileno()
        mode = termios.tcgetattr(descriptor)
        mode[0] &= ~termios.IXON
        termios.tcsetattr(descriptor, termios.TCSANOW, mode)
        curses.def_prog_mode()

    def write(self, sequence: bytes) -> None:
        """Send a control sequence to the terminal."""
        os.write(sys.stdout.fileno(), sequence)

"""End a program quietly when the reader of its output ends first, as in `earthmoving -h | head -1`.

Python raises `BrokenPipeError` then, or prints it at exit. The default action of SIGPIPE is not
restored: it would kill the process without cleaning up, also for a socket that its peer closes
(https://docs.python.org/3/library/signal.html#note-on-sigpipe).
"""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable

__all__ = ["EXIT_BROKEN_PIPE", "end_on_broken_pipe"]

EXIT_BROKEN_PIPE = 1
"""Exit code of a program whose output nothing reads any more, as of other Python programs."""


def end_on_broken_pipe(program: Callable[[], int]) -> int:
    """Run a program and return its exit code, or `EXIT_BROKEN_PIPE` if its output has no reader.

    What the program has printed is flushed, so that a missing reader is noticed here and not at
    exit. `BrokenPipeError` of another pipe is raised.

    Args:
        program: runs the program and returns its exit code; may raise `SystemExit`.
    """
    try:
        try:
            code = program()
        except SystemExit:  # of argparse, which has printed a help text
            _flush()
            raise
        _flush()
        return code
    except BrokenPipeError:
        broken = [number for number in (1, 2) if _has_no_reader(number)]
        if not broken:
            raise
    # What is still in the buffers is flushed at exit, which must not fail again.
    devnull = os.open(os.devnull, os.O_WRONLY)
    for number in broken:
        os.dup2(devnull, number)
    return EXIT_BROKEN_PIPE


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # Python has none if the descriptor was closed before its start
            stream.flush()


def _has_no_reader(descriptor: int) -> bool:
    """Return whether a file descriptor is a pipe or socket whose other end is closed."""
    poll = select.poll()
    poll.register(descriptor, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))

"""Texts of others in logs, messages and diagnostics."""

from __future__ import annotations

__all__ = ["printable"]


def printable(text: str) -> str:
    """Return a text with an escape sequence for each character that cannot be printed.

    A ROS message or a log takes no surrogates, which are what Python makes of bytes that are not
    UTF-8, and a line break in a quoted text could pretend to be another line of the log.
    """
    return "".join(
        each if each.isprintable() else each.encode("unicode_escape").decode("ascii")
        for each in text
    )

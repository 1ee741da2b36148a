"""Checks of command-line options, before a command begins its work."""

from __future__ import annotations

import argparse
from collections.abc import Iterable

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["given_options", "reject_options"]


def given_options(args: argparse.Namespace, names: Iterable[str]) -> list[str]:
    """Return those of some options that are on the command line, as `--in-process`.

    Args:
        args: the parsed command line.
        names: their names in it; without them they are None or False.
    """
    return [
        f"--{name.replace('_', '-')}" for name in names if getattr(args, name) not in (None, False)
    ]


def reject_options(args: argparse.Namespace, names: Iterable[str], reason: str) -> None:
    """Reject options that would have no effect.

    Args:
        args: the parsed command line.
        names: names of the options in it, as in `given_options`.
        reason: why they have none and what to change; it follows the option in the message.

    Raises:
        EarthmovingError: one of them is on the command line.
    """
    for option in given_options(args, names):
        raise EarthmovingError(f"{option} {reason}")

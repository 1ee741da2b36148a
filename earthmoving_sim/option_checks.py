"""Checks of command-line options, before a command begins its work."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["check_output_file", "create_output_folder", "given_options", "reject_options"]


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


def check_output_file(option: str, path: Path, suffixes: Sequence[str] = ()) -> None:
    """Check that a file can be written, before the work begins that gives its content.

    Args:
        option: the option that names it.
        path: the file.
        suffixes: the allowed suffixes, such as `.png`; by default any.

    Raises:
        EarthmovingError: it has another suffix, is a folder, or its folder is missing or read-only.
    """
    if suffixes and path.suffix.lower() not in suffixes:
        raise EarthmovingError(f"{option} {path}: give a name that ends in {' or '.join(suffixes)}")
    if path.is_dir():
        raise EarthmovingError(f"{option} {path} is a folder; give the name of a file")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise EarthmovingError(f"there is no folder for {option} {path}; create it")
    if not os.access(folder, os.W_OK):
        raise EarthmovingError(f"the folder of {option} {path} is read-only; give another")


def create_output_folder(option: str, path: Path) -> None:
    """Create the folder that an option names, if it is missing.

    Raises:
        EarthmovingError: it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EarthmovingError(
            f"the folder {option} {path} cannot be created: {error}; name another"
        ) from error

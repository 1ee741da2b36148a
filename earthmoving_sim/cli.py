"""The `earthmoving` command.

Each subcommand is a module of this package with

- `SUMMARY: str`, one line for the list in `--help`;
- `add_arguments(parser: argparse.ArgumentParser) -> None`, its options;
- `run(args: argparse.Namespace) -> int`, which does the work and returns the exit code.

They are imported to build `--help`, so what they import at the top must be light (no NumPy, no
rclpy); `run` imports the rest. A module's docstring is the description in its own `--help`.
"""

import argparse
import importlib
import io
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import metadata
from typing import Protocol, cast

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SUBCOMMANDS", "build_parser", "main"]

SUBCOMMANDS = ("demo", "check", "machine", "audit")

EXIT_BAD_INPUT = 2  # as argparse does for a bad option
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells expect

_EXAMPLES = """\
examples:
  earthmoving check          is everything here that the simulation needs? if not, what to do
  earthmoving demo           an excavator digs, carries and dumps; writes its results under out/
  earthmoving demo --help    the demo's options
  earthmoving machine check FILE   what is wrong with a machine file?
  earthmoving audit BAG      was one mm3 of soil lost in a recording? where?

exit codes: 0 done, 1 the command's own finding (see its --help), 2 bad input, 130 interrupted
"""


class _Subcommand(Protocol):
    """What a subcommand's module offers."""

    SUMMARY: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None: ...

    def run(self, args: argparse.Namespace) -> int: ...


class _Unavailable:
    """Stands in for a subcommand that does not import: named in `--help`, an error when called.

    So a broken subcommand is seen, and `earthmoving check`, which finds out why, still works.
    """

    def __init__(self, name: str, cause: ImportError) -> None:
        self._problem = f"the subcommand {name!r} cannot be imported: {cause}"
        self.SUMMARY = f"(unavailable: {cause})".replace("%", "%%")  # argparse expands %
        self.__doc__ = self._problem

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """None: its options are unknown."""

    def run(self, args: argparse.Namespace) -> int:
        raise EarthmovingError(f"{self._problem}. Run `earthmoving check` to see what is missing.")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns the process's exit code. `argv` defaults to the command line."""
    _replace_unprintable_characters()
    if threading.current_thread() is threading.main_thread():
        # A kill ends a command as Ctrl-C does: what it has started is stopped, too.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    args = build_parser().parse_args(argv)
    try:
        return int(args.run(args))
    except EarthmovingError as error:
        print(f"earthmoving {args.subcommand}: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print(f"earthmoving {args.subcommand}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


def build_parser() -> argparse.ArgumentParser:
    """The command-line parser, with every subcommand in it."""
    parser = argparse.ArgumentParser(
        prog="earthmoving",
        description="Simulate construction machines moving soil, and account for every bit of it.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {_version()}")
    subparsers = parser.add_subparsers(dest="subcommand", metavar="COMMAND", required=True)
    for name in SUBCOMMANDS:
        module = _load_subcommand(name)
        subparser = subparsers.add_parser(
            name,
            help=module.SUMMARY,
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(subparser)
        subparser.set_defaults(run=module.run)
    return parser


def _load_subcommand(name: str) -> _Subcommand:
    try:
        return cast("_Subcommand", importlib.import_module(f"earthmoving_sim.{name}"))
    except ImportError as error:
        return _Unavailable(name, error)


def _version() -> str:
    try:
        return metadata.version("earthmoving_sim")
    except metadata.PackageNotFoundError:
        return "(not installed: run `make setup`)"


def _replace_unprintable_characters() -> None:
    """Let a terminal that cannot show a character get a `?` instead of an exception."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")

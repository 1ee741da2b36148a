"""The `earthmoving` command; each subcommand is a module of `earthmoving_sim.commands`."""

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
from msg_bridge.processes.broken_pipe import end_on_broken_pipe

__all__ = ["SUBCOMMANDS", "build_parser", "main"]

SUBCOMMANDS = (
    "demo",
    "view",
    "teleop",
    "check",
    "compile",
    "machine",
    "audit",
    "replay",
    "play",
    "report",
    "export",
    "recover",
    "film",
    "figures",
)

EXIT_BAD_INPUT = 2  # as argparse does for a bad option
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells expect

_EXAMPLES = """\
examples:
  earthmoving check                check this computer, with advice on what is missing
  earthmoving compile              compile all kernels, so that the first start takes no longer
  earthmoving demo                 run an excavator; write pictures and a bag
  earthmoving demo --soil "wet clay" --cycles 2
  earthmoving teleop               drive a machine from the keys of this terminal
  earthmoving view BAG             show a recording in the browser
  earthmoving machine check FILE   check a machine file
  earthmoving audit BAG            check that a recording accounts for every mm3 of soil
  earthmoving replay BAG           run a recorded simulation again, and compare every tick
  earthmoving play BAG             publish a recording on ROS topics
  earthmoving report BAG           one page on what machines and soil did in a recording
  earthmoving export BAG           write a recording as Parquet tables
  earthmoving recover BAG          mend a recording that was cut off or damaged
  earthmoving film BAG             make a film of a recording
  earthmoving figures              make pictures after the figures of the reference of 2014

exit codes: 0 success, 1 the command's finding (see its --help) or its output is no longer read,
2 invalid input, 130 interrupted
"""


class _Subcommand(Protocol):
    """Interface of a subcommand's module."""

    SUMMARY: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None: ...

    def run(self, args: argparse.Namespace) -> int: ...


class _Unavailable:
    """Stands in for a subcommand that cannot be imported; an error when it is called.

    So `--help` still lists it, and `earthmoving check`, which finds the cause, still works.
    """

    def __init__(self, name: str, cause: ImportError) -> None:
        self._problem = f"the subcommand {name!r} cannot be imported: {cause}"
        self.SUMMARY = f"(unavailable: {cause})".replace("%", "%%")  # argparse expands %
        self.__doc__ = self._problem

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add nothing: the options are unknown."""

    def run(self, args: argparse.Namespace) -> int:
        raise EarthmovingError(f"{self._problem}. Run `earthmoving check` to see what is missing.")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand and return the exit code; `argv` defaults to the command line."""
    _replace_unprintable_characters()
    if threading.current_thread() is threading.main_thread():
        # SIGTERM ends a command as Ctrl-C does: the processes that it started are stopped.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    return end_on_broken_pipe(lambda: _run_subcommand(argv))


def _run_subcommand(argv: Sequence[str] | None) -> int:
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
    """Return the command-line parser with all subcommands."""
    parser = argparse.ArgumentParser(
        prog="earthmoving",
        description="Simulate construction machines that move soil, exact to the mm3.",
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
        return cast("_Subcommand", importlib.import_module(f"earthmoving_sim.commands.{name}"))
    except ImportError as error:
        return _Unavailable(name, error)


def _version() -> str:
    try:
        return metadata.version("earthmoving_sim")
    except metadata.PackageNotFoundError:
        return "(not installed: run `make setup`)"


def _replace_unprintable_characters() -> None:
    """Print `?` for characters that the terminal cannot show, instead of raising."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")

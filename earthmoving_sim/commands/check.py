"""Check that this computer has what the simulation needs, with advice on what is missing.

Each line is one check: ✓ is fine, ! works with limitations, ✗ must be repaired first.
Exits with 1 if there is a ✗.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from earthmoving_sim.environment.check_result import CheckResult, Status
from earthmoving_sim.environment.dependencies import DEPENDENCIES, check_dependency, check_python
from earthmoving_sim.environment.resources import (
    check_config,
    check_cores,
    check_memory,
    check_output,
)
from earthmoving_sim.environment.ros import check_ros

__all__ = ["SUMMARY", "add_arguments", "all_checks", "run"]

SUMMARY = "check that this computer has what the simulation needs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `earthmoving check`."""
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("out"),
        metavar="DIR",
        help="folder that runs will write to (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Print each check when it is done; return 1 if something required is missing, else 0."""
    counts = dict.fromkeys(Status, 0)
    for result in all_checks(args.output):
        print(result, flush=True)
        counts[result.status] += 1
    missing, warnings = counts[Status.MISSING], counts[Status.WARNING]
    if missing:
        print(
            f"\n{missing} to repair before the simulation can run; follow the → lines from the top."
        )
        return 1
    print(f"\nReady, with {warnings} warning(s)." if warnings else "\nReady.")
    return 0


def all_checks(output: Path) -> Iterator[CheckResult]:
    """Yield the result of each check, in the order in which to repair what is missing."""
    yield check_python()
    for dependency in DEPENDENCIES:
        yield check_dependency(dependency)
    yield check_ros()
    yield check_config()
    yield check_output(output)
    yield check_cores()
    yield check_memory()

"""Dig, carry and dump on real ground, and account for every cubic millimetre.

An excavator drives up, digs five bucketfuls out of a site made from real elevation data, and
dumps them on a spoil heap. Ends with a summary and pictures; exits with 1 if soil was lost.
"""

import argparse
from pathlib import Path

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "an excavator digs, carries and dumps on real ground; draws what it did"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The demo's options."""
    parser.add_argument("--cycles", type=int, default=5, help="bucketfuls to move (default 5)")
    parser.add_argument(
        "--out", type=Path, default=Path("out/demo"), help="folder for results (default out/demo)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the scatter of soil (default 0)")
    parser.add_argument("--no-pictures", action="store_true", help="end with the summary")


def run(args: argparse.Namespace) -> int:
    """Run it; 0 if the ledger closed, 1 if not."""
    from earthmoving_sim.dig_run import DigRun, RunOptions
    from earthmoving_sim.report import print_summary, write_pictures

    dig = DigRun(RunOptions(cycles=args.cycles, seed=args.seed))
    try:
        outcome = dig.run(progress=True)
    finally:
        dig.close()
    print_summary(outcome)
    if not args.no_pictures:
        for path in write_pictures(outcome, args.out):
            print(f"  picture   {path}")
    return 0 if outcome.balanced else 1

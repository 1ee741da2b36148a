"""Dig, carry and dump on real ground, and account for every cubic millimetre.

An excavator drives up, digs five bucketfuls out of a site made from real elevation data, and
dumps them on a spoil heap. Ends with a summary and pictures; exits with 1 if soil was lost.
"""

import argparse
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "an excavator digs, carries and dumps on real ground; draws what it did"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The demo's options."""
    parser.add_argument(
        "--config", default="demo.yaml", metavar="FILE", help="parameters (default: demo.yaml)"
    )
    parser.add_argument("--cycles", type=int, help="bucketfuls to move (default: 5)")
    parser.add_argument("--seed", type=int, help="of the scatter of released soil (default: 0)")
    parser.add_argument(
        "--terrain",
        type=Path,
        metavar="FILE",
        help="dig there instead: .npy, .npz, 16-bit .png, .asc or .tif; the middle of the map"
        " should be fairly level",
    )
    parser.add_argument(
        "--cell", type=float, help="spacing of the terrain's points [m], where its file has none"
    )
    parser.add_argument(
        "--height-range",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="heights [m] of black and white in a .png",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/demo"), help="folder for pictures (out/demo)"
    )
    parser.add_argument("--no-pictures", action="store_true", help="end with the summary")


def run(args: argparse.Namespace) -> int:
    """Run it; 0 if all cycles were done and the ledger closed at every tick, else 1."""
    from earthmoving_sim.dig_run import DigRun
    from earthmoving_sim.report import print_summary, write_pictures
    from earthmoving_sim.run_config import load_run_config
    from soil_sim.terrain import load_terrain

    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EarthmovingError(f"--out {args.out} cannot be made: {error}; name another") from error
    asked = {"cycles": args.cycles, "seed": args.seed}
    config = load_run_config(args.config, {k: v for k, v in asked.items() if v is not None})
    heights = tuple(args.height_range) if args.height_range else None
    site = None
    if args.terrain:
        site = load_terrain(args.terrain, cell=args.cell, height_range=heights)
    print("Compiling kernels (some seconds the first time) and setting up the site ...", flush=True)
    dig = DigRun(config, site)
    try:
        outcome = dig.run(progress=True)
    finally:
        dig.close()
    print_summary(outcome)
    if not args.no_pictures:
        for path in write_pictures(outcome, args.out):
            print(f"  picture   {path}")
    return 0 if outcome.balanced else 1

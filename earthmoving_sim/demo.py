"""Dig, carry and dump on real ground, and account for every cubic millimetre.

An excavator drives up, digs five bucketfuls out of a site made from real elevation data, and
dumps them on a spoil heap. Soil, machine, operator and recorder run as ROS 2 nodes; summary and
pictures are made from the bag they leave. Exits with 1 if soil was lost.
"""

from __future__ import annotations

import argparse
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from msg_bridge.contract.errors import EarthmovingError

if TYPE_CHECKING:  # light at import, so that `--help` is quick
    from earthmoving_sim.dig_outcome import DigOutcome
    from earthmoving_sim.run_config import RunConfig
    from soil_sim.terrain import HeightMap

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
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="no nodes, no DDS, no bag: all parts in this process, at full speed",
    )
    parser.add_argument(
        "--realtime",
        action="store_true",
        help="let ticks follow the wall clock; else as fast as it goes, and repeatable",
    )
    parser.add_argument(
        "--bag", type=Path, help="folder to record into (default: bags/demo-<time>)"
    )
    parser.add_argument("--no-pictures", action="store_true", help="end with the summary")


def run(args: argparse.Namespace) -> int:
    """Run it; 0 if all cycles were done and the ledger closed at every tick, else 1."""
    from earthmoving_sim.demo_site import jacksboro_site
    from earthmoving_sim.report import print_summary, write_pictures
    from earthmoving_sim.run_config import load_run_config
    from soil_sim.terrain import load_terrain

    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EarthmovingError(f"--out {args.out} cannot be made: {error}; name another") from error
    overrides = {"cycles": args.cycles, "seed": args.seed}
    config = load_run_config(args.config, {k: v for k, v in overrides.items() if v is not None})
    heights = tuple(args.height_range) if args.height_range else None
    site = jacksboro_site()
    if args.terrain:
        site = load_terrain(args.terrain, cell=args.cell, height_range=heights)
    outcome = _in_process(config, site) if args.in_process else _as_nodes(config, site, args)
    print_summary(outcome)
    if not args.no_pictures:
        for path in write_pictures(outcome, args.out):
            print(f"  picture   {path}")
    return 0 if outcome.is_balanced else 1


def _in_process(config: RunConfig, site: HeightMap) -> DigOutcome:
    from earthmoving_sim.single_process_dig import SingleProcessDig

    print("Compiling kernels (some seconds the first time) and setting up the site ...", flush=True)
    dig = SingleProcessDig(config, site)
    try:
        return dig.run(progress=True)
    finally:
        dig.close()


def _as_nodes(config: RunConfig, site: HeightMap, args: argparse.Namespace) -> DigOutcome:
    from earthmoving_sim.multi_process.dig import run_multi_process_dig
    from earthmoving_sim.recorded_run.outcome import outcome_from_bag

    now = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H-%M-%SZ")
    bag = args.bag or Path("bags", f"demo-{now}")
    print(
        "Starting the nodes recorder, soil_sim, machine_sim and operator; kernels are compiled the"
        " first time ...",
        flush=True,
    )
    run_multi_process_dig(config, site, args.out / "nodes", bag, realtime=args.realtime)
    print(f"Reading {bag} ...", flush=True)
    outcome = outcome_from_bag(bag)
    print(f"  bag       {bag}: `earthmoving audit {bag}` counts every cubic millimetre again\n")
    return outcome

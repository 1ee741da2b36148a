"""Dig, carry and dump with an excavator, and account for every cubic millimetre.

An excavator drives up, digs five bucketfuls and dumps them on a spoil heap. The site is made from
real elevation data: a piece of the Jacksboro fault (SRTM, part of matplotlib), scaled to 51 m with
2.5 m of relief and slopes of at most 20 degrees; `--terrain` chooses another site. Soil, machine,
operator and recorder run as ROS 2 nodes; the summary and the pictures are made from their
recording. Exits with 1 if soil was lost or the task was aborted. With `--view` the run is shown in
the browser, and afterwards its recording, until Ctrl-C.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from earthmoving_sim.option_checks import create_output_folder, reject_options
from msg_bridge.contract.errors import EarthmovingError

if TYPE_CHECKING:  # light at import, so that `--help` is quick
    from earthmoving_sim.dig_outcome import DigOutcome
    from earthmoving_sim.multi_process.dig import ObserverNode
    from earthmoving_sim.run_config import RunConfig
    from soil_sim.terrain import HeightMap

__all__ = ["SUMMARY", "add_arguments", "run"]

_PAGE_PORT = 8080
"""Port of the live page, if it is free."""

_FOXGLOVE_PORT = 8765
"""Port of the Foxglove server, if it is free."""

_MAX_LOADS = 1000
"""Number of loads that a run of a given duration does not reach."""

SUMMARY = "run an excavator that digs, carries and dumps; write a summary and pictures"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the demo's options."""
    parser.add_argument(
        "--config",
        metavar="FILE",
        help="parameters that differ from config/demo.yaml, in its format or in that of the nodes'"
        " parameter files",
    )
    parser.add_argument(
        "--load",
        action="store_true",
        help="load a dumper, which hauls two loads and tips them (config/demo_load.yaml)",
    )
    parser.add_argument("--loads", type=int, help="with --load: number of loads (default: 2)")
    parser.add_argument(
        "--minutes",
        type=float,
        help="with --load, instead of a number of loads: simulated time after which no other load"
        " is begun",
    )
    parser.add_argument(
        "--soil", metavar="NAME", help="kind of soil, a name in config/soils.yaml such as loam"
    )
    parser.add_argument("--cycles", type=int, help="number of bucketfuls to move (default: 5)")
    parser.add_argument(
        "--seed", type=int, help="seed of the scatter of released soil (default: 0)"
    )
    parser.add_argument(
        "--terrain",
        type=Path,
        metavar="FILE",
        help="terrain file: .npy, .npz, 16-bit .png, .asc or .tif; its middle should be fairly"
        " level (default: the site made from real elevation data)",
    )
    parser.add_argument(
        "--cell",
        type=float,
        help="with --terrain: spacing of its points [m], if the file has none",
    )
    parser.add_argument(
        "--height-range",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="with --terrain: heights [m] of black and white in a .png",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/demo"),
        help="folder for pictures, logs and parameters of the nodes, overwritten (out/demo)",
    )
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="run all parts in this process, without nodes, DDS and bag",
    )
    parser.add_argument(
        "--realtime",
        action="store_true",
        help="let ticks of nodes follow the wall clock (default: as fast as possible, and"
        " repeatable)",
    )
    parser.add_argument(
        "--bag", type=Path, help="folder to record nodes into (default: bags/demo-<time>)"
    )
    parser.add_argument(
        "--view",
        action="store_true",
        help="show the run in the browser, at the printed address, and afterwards its recording,"
        " until Ctrl-C; --realtime shows it at the speed of the machine",
    )
    parser.add_argument(
        "--foxglove",
        action="store_true",
        help="serve all topics to Foxglove and Lichtblick during the run, at the printed address",
    )
    parser.add_argument("--no-pictures", action="store_true", help="write no pictures")


def run(args: argparse.Namespace) -> int:
    """Run the demo; return 0 if it finished and the ledger was balanced at every tick, else 1."""
    from earthmoving_sim.report import print_summary, write_pictures
    from earthmoving_sim.run_config import load_run_config

    _check_options(args)
    overrides = _overrides(args)
    create_output_folder("--out", args.out)
    base = "demo_load.yaml" if args.load else "demo.yaml"
    config = load_run_config(args.config or base, overrides, soil=args.soil or "", base=base)
    if config.unused:
        print(f"{args.config}: the demo does not use {', '.join(config.unused)}", flush=True)
    site = _site(args)
    bag = args.bag or Path("bags", f"demo-{datetime.now(timezone.utc):%Y-%m-%dT%H-%M-%SZ}")
    observers = [_foxglove_server()] if args.foxglove else []
    view_port = _start_page() if args.view else None
    if view_port is not None:
        observers.append(_viewer(view_port))
    if args.in_process:
        outcome = _run_in_process(config, site)
    else:
        outcome = _run_nodes(config, site, args, bag, observers)
    print_summary(outcome, config.soil_description)
    if not args.no_pictures:
        for path in write_pictures(outcome, args.out):
            print(f"  picture   {path}")
    if view_port is not None:
        from viewer.bag_server import serve_bag

        serve_bag(bag, view_port, open_browser=False)
    return 0 if outcome.is_successful else 1


def _check_options(args: argparse.Namespace) -> None:
    """Check that every option has an effect.

    Raises:
        EarthmovingError: one has none, or two exclude each other.
    """
    if args.in_process:
        reject_options(
            args, ("view", "foxglove"), "shows what nodes publish; leave out --in-process"
        )
        reject_options(args, ("bag",), "records what nodes publish; leave out --in-process")
        reject_options(args, ("realtime",), "is a mode of the nodes; leave out --in-process")
    if args.terrain is None:
        reject_options(args, ("cell", "height_range"), "describes a terrain file; add --terrain")
    if args.load:
        reason = "counts bucketfuls on the ground; with --load give --loads or --minutes"
        reject_options(args, ("cycles",), reason)
    else:
        reject_options(args, ("loads", "minutes"), "is for a dumper that is loaded; add --load")
    if args.loads is not None and args.minutes is not None:
        raise EarthmovingError("--loads and --minutes both end the run; give one of them")


def _overrides(args: argparse.Namespace) -> dict[str, int | float]:
    """Return the parameters of task and run that the options name.

    Raises:
        ParameterError: a value is out of range.
    """
    from dig_operator import DigTaskParams
    from earthmoving_sim.config_layers import RunParams
    from msg_bridge.contract.parameters import check_value

    overrides: dict[str, int | float] = {}
    for kind, names in ((DigTaskParams, ("cycles", "loads")), (RunParams, ("seed",))):
        given = {name: getattr(args, name) for name in names if getattr(args, name) is not None}
        kind.from_mapping(given, prefix="--")
        overrides |= given
    if args.minutes is not None:
        duration = 60.0 * args.minutes
        field = DigTaskParams.__dataclass_fields__["duration"]
        check_value(f"--minutes {args.minutes:g}", field, duration)
        overrides |= {"duration": duration, "loads": _MAX_LOADS}
    return overrides


def _site(args: argparse.Namespace) -> HeightMap:
    """Return the terrain of the options, by default the site made from real elevation data."""
    from earthmoving_sim.demo_site import jacksboro_site
    from soil_sim.terrain import load_terrain

    if args.terrain is None:
        return jacksboro_site()
    heights = tuple(args.height_range) if args.height_range else None
    return load_terrain(args.terrain, cell=args.cell, height_range=heights)


def _run_in_process(config: RunConfig, site: HeightMap) -> DigOutcome:
    from earthmoving_sim.single_process_dig import SingleProcessDig

    print("Setting up the site ...", flush=True)
    dig = SingleProcessDig(config, site)
    try:
        return dig.run(progress=True)
    finally:
        dig.close()


def _start_page() -> int:
    """Print the address of the live page, and open it once its server listens; return its port."""
    from viewer.address import free_port, page_address
    from viewer.browser import open_page_when_ready

    port = free_port(_PAGE_PORT)
    address = page_address("127.0.0.1", port)
    print(f"The live page is at {address}", flush=True)
    open_page_when_ready(address, port)
    return port


def _viewer(port: int) -> ObserverNode:
    """Return the viewer of the live page; clients must not change the result."""
    from earthmoving_sim.multi_process.dig import ObserverNode

    forbidden = {"allow_driving": "false", "allow_simulation_control": "false"}
    return ObserverNode("viewer", "viewer.node", {"port": str(port), **forbidden})


def _foxglove_server() -> ObserverNode:
    """Print the address of the Foxglove server, and return the server.

    Raises:
        FoxgloveServerError: foxglove-sdk is not installed.
    """
    from earthmoving_sim.multi_process.dig import ObserverNode
    from msg_bridge.foxglove_server.sdk import load_sdk
    from viewer.address import free_port

    load_sdk()
    port = free_port(_FOXGLOVE_PORT)
    print(f"Foxglove and Lichtblick find the run at ws://127.0.0.1:{port}", flush=True)
    module = "msg_bridge.foxglove_server.node"
    return ObserverNode("foxglove_server", module, {"port": str(port)})


def _run_nodes(
    config: RunConfig,
    site: HeightMap,
    args: argparse.Namespace,
    bag: Path,
    observers: Sequence[ObserverNode],
) -> DigOutcome:
    from earthmoving_sim.multi_process.dig import run_multi_process_dig
    from earthmoving_sim.recorded_run.outcome import outcome_from_bag

    operators = "dig_operator" if config.truck_machine is None else "two operators"
    print(
        f"Starting the nodes exchange_recorder, soil_sim, machine_sim and {operators} ...",
        flush=True,
    )
    run_multi_process_dig(
        config, site, args.out / "nodes", bag, realtime=args.realtime, observers=observers
    )
    print(f"Reading {bag} ...", flush=True)
    outcome = outcome_from_bag(bag)
    print(f"  bag       {bag}: `earthmoving audit {bag}` checks its volumes tick by tick\n")
    return outcome

"""Write a report on a recording: one HTML page, and its figures as PNG files.

The page has the terrain before and after with cut and fill, the accounts of the soil over time, and
for each machine its payload with the detected cycles, joints, cylinders, tracks, and latency of
commands; then late ticks, rejected inputs and reported problems, and the setup. Parts whose topics
are not recorded are left out with the reason.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "write a report on a recording: one HTML page with figures"

_FOLDER = Path("out/report")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bag and where the report is written."""
    parser.add_argument("bag", type=Path, help="folder of a bag, or an .mcap file")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="folder of the page and the pictures (default: out/report/<name of the bag>)",
    )
    parser.add_argument("--title", default="", help="heading (default: the name of the bag)")
    parser.add_argument(
        "--run", type=int, metavar="ID", dest="run_id", help="run of a bag with several (the last)"
    )
    parser.add_argument(
        "--namespace", help="namespace of the simulation; needed if the bag has several"
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(args: argparse.Namespace) -> int:
    """Write the report and print where it is; return 0.

    Raises:
        EarthmovingError: the bag cannot be read, or the report cannot be written.
    """
    from earthmoving_sim.reading_progress import reading_progress
    from earthmoving_sim.run_report import write_report
    from msg_bridge.bag.bag_files import bag_name
    from msg_bridge.bag.reader import BagReader

    reader = BagReader(args.bag, namespace=args.namespace)
    folder = args.output or _FOLDER / bag_name(args.bag)
    report = write_report(
        reader, folder, title=args.title, run_id=args.run_id, progress=reading_progress()
    )
    if args.json:
        content = {
            "path": str(args.bag),
            "page": str(report.page),
            "runs": report.run_ids,
            "truncated": list(reader.truncated),
            "malformed": report.malformed,
            **report.summary.to_dict(),
        }
        print(json.dumps(content, indent=2))
    else:
        print(report.page)
    return 0

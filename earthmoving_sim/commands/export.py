"""Export bags as Parquet tables, for pandas, Polars, DuckDB, Spark or MATLAB.

Each topic of a bag becomes a table: `<output>/bag=<name>/<topic>.parquet`. Units are metadata of
the columns. A folder of bags is analysed at once with the name of each bag as a column, as in
`examples/analyse_bags.py`. Exits with 0 if all messages were exported, with 1 if some were not.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.count_text import count_text

if TYPE_CHECKING:
    from earthmoving_sim.bag_export import BagExport

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "export bags as Parquet tables"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bags and what is exported."""
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help="bags or .mcap files")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out/export"),
        metavar="FOLDER",
        help="folder of the tables (default: %(default)s)",
    )
    parser.add_argument(
        "--include", default="", metavar="REGEX", help="only topics whose names match"
    )
    parser.add_argument("--exclude", default="", metavar="REGEX", help="no topics that match")
    parser.add_argument(
        "--maps",
        choices=("ends", "all", "none"),
        default="ends",
        help="terrain maps: the first and the last one, all, or none (default: %(default)s)",
    )
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="remove the tables of a former export of a bag of this name first",
    )
    parser.add_argument(
        "--namespace", default="/", help="only topics below it, named relative to it"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Export the bags and print what was written; return 0 if it was everything, else 1.

    Raises:
        EarthmovingError: one of the bags cannot be exported; then nothing is written.
    """
    try:
        from earthmoving_sim.bag_export import check_export, export_bag
        from earthmoving_sim.bag_export.parquet_file import ExportError
    except ImportError as error:
        raise EarthmovingError(f"{error}; the export needs pyarrow: pip install pyarrow") from error
    from earthmoving_sim.reading_progress import reading_progress
    from msg_bridge.bag.bag_files import bag_name
    from msg_bridge.bag.reader import BagReader
    from msg_bridge.raw_topics.topic_selection import is_topic_selected, validate_expression

    for name in ("include", "exclude"):
        validate_expression(f"--{name}", getattr(args, name))
    folders = [args.output / f"bag={bag_name(bag)}" for bag in args.bags]
    if len(set(folders)) < len(folders):
        raise ExportError("two of the bags have the same name; export them to different folders")
    readers = [BagReader(bag, namespace=args.namespace) for bag in args.bags]
    selection: dict[str, Any] = {
        "is_selected": lambda topic: is_topic_selected(topic, args.include, args.exclude),
        "maps": args.maps,
        "overwrite": args.overwrite,
    }
    for reader, folder in zip(readers, folders, strict=True):
        check_export(reader, folder, **selection)
    reports = []
    is_complete = True
    for reader, folder in zip(readers, folders, strict=True):
        export = export_bag(reader, folder, progress=reading_progress(), **selection)
        reports.append(_report(export, reader.path))
        is_complete = is_complete and export.is_complete
        if not args.json:
            print("\n".join(_lines(export, reader.path)), flush=True)
    if args.json:
        print(json.dumps(reports, indent=2))
    return 0 if is_complete else 1


def _lines(export: BagExport, bag: Path) -> Iterator[str]:
    num_rows = sum(each.num_rows for each in export.topics)
    tables = [each for each in export.topics if each.file is not None]
    size = sum(each.file.stat().st_size for each in tables if each.file is not None)
    counts = f"{num_rows:,} rows in {len(tables)} tables, {size / 1e6:.1f} MB"
    yield f"{bag}: {counts}, in {export.folder}"
    for name in export.truncated:
        yield f"  {name} has no end; what came after its last chunk is lost"
    for each in export.topics:
        if each.reason:
            yield f"  {each.topic} is not exported: {each.reason}"
        elif each.num_rejected:
            num_rejected = count_text(each.num_rejected, "message")
            yield f"  {each.topic}: {num_rejected} left out, of another layout"


def _report(export: BagExport, bag: Path) -> dict[str, Any]:
    return {
        "path": str(bag),
        "folder": str(export.folder),
        "truncated": list(export.truncated),
        "topics": [
            {
                "topic": each.topic,
                "type": each.type,
                "file": None if each.file is None else str(each.file),
                "rows": each.num_rows,
                "messages": each.num_messages,
                "left_out": each.num_rejected,
                "reason": each.reason,
            }
            for each in export.topics
        ],
    }

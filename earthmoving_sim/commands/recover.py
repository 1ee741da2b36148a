"""Recover a bag that was cut off by a crash, or whose files are damaged.

Everything that can be read is written into another bag with its index and metadata.yaml, which
`ros2 bag` needs; the bag itself is not changed. Damaged parts are skipped and named with the time
that they covered. Files that were compressed as a whole, as by `ros2 bag record --compression-mode
file`, are decompressed. Exits with 0 if nothing was lost but an end that was never written, with 1
if parts were damaged or a file is missing. A bag that is complete and undamaged is not written
again.
"""

from __future__ import annotations

import argparse
import json
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msg_bridge.count_text import count_text

if TYPE_CHECKING:
    from msg_bridge.bag_recovery import RecoveredBag
    from msg_bridge.bag_recovery.salvage import Damage

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "recover a bag that was cut off or damaged"

_NANO = 1e9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `earthmoving recover`."""
    parser.add_argument("bag", type=Path, help="folder of a bag, or an .mcap file")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="folder of the new bag (default: <bag>-recovered beside the bag)",
    )
    parser.add_argument(
        "--compression",
        choices=("zstd", "lz4", "none"),
        default="zstd",
        help="compression of the new bag (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Recover the bag and print what was lost; return 0 if nothing was, else 1."""
    from earthmoving_sim.reading_progress import reading_progress
    from msg_bridge.bag.bag_files import bag_name
    from msg_bridge.bag_recovery import recover_bag

    bag = Path(args.bag)
    folder = args.output or bag.absolute().parent / f"{bag_name(bag)}-recovered"
    recovered = recover_bag(bag, folder, compression=args.compression, progress=reading_progress())
    is_needed = not recovered.is_intact
    if args.json:
        print(json.dumps(_report(recovered, bag, is_needed=is_needed), indent=2))
    else:
        print("\n".join(_lines(recovered, bag, is_needed=is_needed)))
    return 1 if recovered.has_losses else 0


def _lines(recovered: RecoveredBag, bag: Path, *, is_needed: bool) -> list[str]:
    if not is_needed:
        return [f"{bag}: {count_text(recovered.messages, 'message')}, complete and undamaged"]
    lines = [f"{bag}: {count_text(recovered.messages, 'message')} recovered"]
    for file in recovered.files:
        state = "has its end" if file.is_complete else "has no end"
        lines.append(f"  {file.path.name}: {count_text(file.messages, 'message')}, {state}")
        if file.is_compressed:
            lines.append("    was compressed as a whole; bytes are those of its content")
        if file.num_cut_off:
            lines.append(f"    {file.num_cut_off:,} from a chunk that was cut off")
        if file.num_compressed:
            num_compressed = count_text(file.num_compressed, "message")
            lines.append(f"    {num_compressed} compressed one by one; they are decompressed")
        if file.num_undecompressed:
            num_left_out = count_text(file.num_undecompressed, "message")
            lines.append(f"    ✗ {num_left_out} left out: the compressed data are damaged")
        if file.num_without_channel:
            num_left_out = count_text(file.num_without_channel, "message")
            lines.append(f"    ✗ {num_left_out} left out: the topic is lost")
        lines += [f"    {'✗' if each.is_loss else '-'} {_describe(each)}" for each in file.damages]
    if not recovered.had_metadata:
        lines.append("  - metadata.yaml: is missing or damaged; it is made again")
    for name in recovered.missing:
        lines.append(
            f"  {'-' if recovered.is_renamed else '✗'} {name}: is not there, but in metadata.yaml"
        )
    lines.append(f"  written to {recovered.folder}")
    return lines


def _describe(damage: Damage) -> str:
    if not damage.length:
        return damage.text
    text = f"byte {damage.offset:,}, {damage.length:,} bytes: {damage.text}"
    if damage.start is None or damage.end is None:
        return text
    return f"{text}; messages from {_time(damage.start)} to {_time(damage.end)}"


def _time(nanoseconds: int) -> str:
    """Return a log time as date and time (UTC), or in seconds if it is a simulation time."""
    seconds = nanoseconds / _NANO
    if not 1e9 <= seconds < 1e11:
        return f"{seconds:.3f} s"
    return datetime.fromtimestamp(seconds, timezone.utc).isoformat(timespec="milliseconds")


def _report(recovered: RecoveredBag, bag: Path, *, is_needed: bool) -> dict[str, Any]:
    return {
        "path": str(bag),
        "recovered_into": str(recovered.folder) if is_needed else None,
        "messages": recovered.messages,
        "had_metadata": recovered.had_metadata,
        "missing_files": list(recovered.missing),
        "files": [
            {
                "file": each.path.name,
                "messages": each.messages,
                "had_end": each.is_complete,
                "was_compressed": each.is_compressed,
                "cut_off_messages": each.num_cut_off,
                "messages_without_topic": each.num_without_channel,
                "compressed_messages": each.num_compressed,
                "damaged_compressed_messages": each.num_undecompressed,
                "damages": [
                    {
                        "offset": part.offset,
                        "bytes": part.length,
                        "text": part.text,
                        "is_loss": part.is_loss,
                        "start_ns": part.start,
                        "end_ns": part.end,
                    }
                    for part in each.damages
                ],
            }
            for each in recovered.files
        ],
    }

"""Dig in LIGGGHTS and in this project, and compare; see `benchmarks.resolved_dig`."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.liggghts_runner import LiggghtsError
from benchmarks.resolved_dig.comparison import (
    compare,
    draw_comparison,
    read_tables,
    write_tables,
)
from benchmarks.resolved_dig.dig import record_dig
from benchmarks.resolved_dig.liggghts_bed import RADIUS, dig_in_liggghts


def main() -> int:
    """Run both; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--radius", type=float, default=RADIUS,
        help="radius of the spheres [m]; the default makes 112,000, which take 25 minutes",
    )  # fmt: skip
    parser.add_argument(
        "--recorded", type=Path, metavar="FOLDER",
        help="compare with the dig in LIGGGHTS in the tables of a folder, such as validation",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("out/resolved_dig"), help="folder")
    args = parser.parse_args()
    dig = record_dig()
    print(f"dug for {dig.times[-1]:.1f} s", flush=True)
    try:
        if args.recorded is not None:
            resolved = read_tables(args.recorded, "liggghts", dig)
        else:
            print(f"now LIGGGHTS, with spheres of {args.radius:g} m", flush=True)
            with tempfile.TemporaryDirectory() as temporary:
                resolved = dig_in_liggghts(dig, args.radius, Path(temporary))
    except (LiggghtsError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    digs = {"this project": dig, "LIGGGHTS": resolved}
    write_tables(args.out, {"ours": dig, "liggghts": resolved})
    draw_comparison(args.out / "resolved_dig.png", digs)
    for name, ratio in compare(dig, resolved)._asdict().items():
        print(f"{name:7s} {ratio:.2f} x LIGGGHTS")
    return 0


if __name__ == "__main__":
    sys.exit(main())

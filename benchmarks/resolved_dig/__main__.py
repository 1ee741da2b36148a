"""Dig in LIGGGHTS and in this project, and compare; see `benchmarks.resolved_dig`."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.liggghts_runner import LiggghtsError
from benchmarks.resolved_dig.comparison import compare, draw_comparison, write_tables
from benchmarks.resolved_dig.dig import record_dig
from benchmarks.resolved_dig.liggghts_bed import Bed, dig_in_liggghts


def main() -> int:
    """Run both; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--radius", type=float, default=0.026,
        help="radius of the spheres [m]; 0.026 makes 92,000, which take 20 minutes",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("out/resolved_dig"), help="folder")
    args = parser.parse_args()
    dig = record_dig()
    print(
        f"dug for {dig.times[-1]:.1f} s; now LIGGGHTS, with spheres of {args.radius:g} m",
        flush=True,
    )
    with tempfile.TemporaryDirectory() as temporary:
        try:
            resolved = dig_in_liggghts(dig, Bed(args.radius), Path(temporary))
        except LiggghtsError as error:
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

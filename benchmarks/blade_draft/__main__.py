"""Print draft forces of blades beside measured ones and those in spheres.

See `benchmarks.blade_draft`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from benchmarks.blade_draft.chart import draw_chart
from benchmarks.blade_draft.measured import SANDS, Draft, read_tests, simulate
from benchmarks.blade_draft.resolved import (
    RECORDED,
    WINDOWS,
    ResolvedDrag,
    read_drags,
    record_drags,
    simulate_drag,
)
from benchmarks.blade_draft.sphere_drag import RADIUS
from benchmarks.liggghts_runner import LiggghtsError

_CELLS = (0.05, 0.04, 0.025)
"""Cell sizes over which the force beside measured ones is averaged [m]."""


def main() -> int:
    """Print both tables; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--resolve", action="store_true",
        help="drag the blades through LIGGGHTS again (half an hour), and record the forces",
    )  # fmt: skip
    parser.add_argument("--radius", type=float, default=RADIUS, help="of the spheres [m]")
    parser.add_argument("--chart", type=Path, metavar="FILE", help="draw the forces into a picture")
    args = parser.parse_args()
    try:
        if args.resolve:
            record_drags(RECORDED, args.radius)
        resolved = read_drags()
    except (LiggghtsError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    drafts = _compare_with_measured()
    drags = [(_compare_with_spheres(drag), drag) for drag in resolved]
    if args.chart is not None:
        draw_chart(args.chart, drafts, drags)
    return 0


def _compare_with_measured() -> list[Draft]:
    print("width depth  measured  " + "  ".join(f"{sand:>24}" for sand in SANDS))
    drafts = []
    for test in read_tests():
        draft = simulate(test, _CELLS)
        drafts.append(draft)
        cells = "  ".join(
            f"{np.mean(draft.forces[sand]):12.0f} N ({draft.ratio(sand):.2f} x)" for sand in SANDS
        )
        print(f"{test.width:.2f}  {test.depth:.2f}  {test.force:6.0f} N  {cells}", flush=True)
    for sand in SANDS:
        ratios = np.array([draft.ratio(sand) for draft in drafts])
        print(
            f"{sand}: {ratios.mean():.2f} x on average, {ratios.min():.2f} to {ratios.max():.2f}; "
            f"mean deviation {100.0 * np.abs(ratios - 1.0).mean():.0f} %"
        )
    return drafts


def _compare_with_spheres(spheres: ResolvedDrag) -> ResolvedDrag:
    ours = simulate_drag(spheres.blade)
    blade = spheres.blade
    print(
        f"\nwidth {blade.width:g} m, rake {blade.rake:g} deg, {blade.soil}: draft over LIGGGHTS's"
    )
    for (low, high), a, b in zip(WINDOWS, ours.forces, spheres.forces, strict=True):
        print(
            f"  {low:.2f} to {high:.2f} m: {a[0] / b[0]:.2f} x; lift over draft "
            f"{a[1] / a[0]:+.2f}, LIGGGHTS {b[1] / b[0]:+.2f}",
            flush=True,
        )
    return ours


if __name__ == "__main__":
    sys.exit(main())

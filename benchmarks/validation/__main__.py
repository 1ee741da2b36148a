"""All experiments of the laboratory, beside what is known of real soil.

Prints a table; takes a quarter of an hour, and with --quick, whose numbers are rough, about two
minutes. Run from the repository root: `python -m benchmarks.validation [--quick] [--chart FILE]`.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.validation.angle_of_repose import poured_repose_angle
from benchmarks.validation.bucket_transport import TransportResult, transport_soil
from benchmarks.validation.column_collapse import Collapse, axisymmetric, planar
from benchmarks.validation.full_speed_scoop import run_scoop
from benchmarks.validation.heap_creep import resting_heap
from benchmarks.validation.hopper_outflow import OPENINGS, Flow, flow_exponent, outflow
from earthmoving_sim.pictures.style import (
    CUT,
    DPI,
    FILL,
    GREY,
    INK,
    LABEL,
    SMALL,
    add_axes,
    new_figure,
)
from machine_sim.dem import warm_up
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils.soil_types import load_soil_types

SOIL = LooseSoil(tool_friction=17.0)
"""Of all experiments but the poured heaps: 30 degrees."""
COLUMNS = ((0.5, 100_000), (1.0, 20_000), (2.0, 20_000), (3.0, 20_000))
"""Aspect ratios, and particles: a flat column must not be too few of them high."""
QUICK_COLUMN = 5000
POURED = ("reference", "dry sand", "gravel", "wet clay")
SHAPES = {"axisymmetric": axisymmetric, "planar": planar}


@dataclass(frozen=True)
class Row:
    """A line of the table: what is checked, what real soil does, what was found, and if it fits."""

    check: str
    expected: str
    found: str
    within: bool


@dataclass
class Results:
    """What the chart shows.

    Attributes:
        collapses: by shape of the column.
        flows: through openings.
        angles: asked and found [deg], by soil.
    """

    collapses: dict[str, list[Collapse]] = field(default_factory=dict)
    flows: list[Flow] = field(default_factory=list)
    angles: dict[str, tuple[float, float]] = field(default_factory=dict)


def columns(quick: bool, results: Results) -> Iterator[Row]:
    """Columns that collapse."""
    for name, shape in SHAPES.items():
        results.collapses[name] = []
        for aspect, most in COLUMNS:
            count = QUICK_COLUMN if quick else most
            found = shape(SOIL, aspect, count, capacity=count)
            results.collapses[name].append(found)
            yield Row(
                f"runout of a column, {name}, {found.aspect:.2f} high, {count} particles",
                f"{found.law:.2f} +- 15 %",
                f"{found.runout:.2f} ({100.0 * (found.ratio - 1.0):+.0f} %)",
                abs(found.ratio - 1.0) <= 0.15,
            )


def heaps(results: Results) -> Iterator[Row]:
    """Heaps poured from soils as found."""
    kinds = load_soil_types()
    for name in POURED:
        kind = kinds[name]
        asked = math.degrees(kind.repose_angle_at(kind.moisture))
        found = poured_repose_angle(kind.loose_soil, 4000, moisture=kind.moisture)
        results.angles[name] = asked, found
        yield Row(
            f"poured angle of {name} [deg]",
            f"{asked:.1f} +- 2",
            f"{found:.1f}",
            abs(found - asked) <= 2.0,
        )


def rests(quick: bool) -> Iterator[Row]:
    """A heap left alone, nobody asleep."""
    watch = 20.0 if quick else 60.0
    found = resting_heap(SOIL, 5000, watch=watch, allow_sleeping=False)
    yield Row(
        f"energy of a heap after {watch:g} s [weight x diameter]",
        "< 1e-8",
        f"{found.energy:.1e}",
        found.energy < 1e-8,
    )
    yield Row(
        f"creep of a heap in {watch:g} s [diameters]",
        "< 1e-3",
        f"{found.creep:.1e}",
        found.creep < 1e-3,
    )


def hoppers(quick: bool, results: Results) -> Iterator[Row]:
    """Outflow of bins."""
    for opening in OPENINGS:
        found = outflow(SOIL, opening, passing=2000 if quick else 8000)
        results.flows.append(found)
        yield Row(
            f"outflow through {opening:g} diameters [particles/s]",
            f"{found.law:.0f} +- 25 %",
            f"{found.rate:.0f} (+- {100.0 * found.error:.1f} %)",
            abs(found.rate / found.law - 1.0) <= 0.25,
        )
    power = flow_exponent(results.flows)
    yield Row("exponent of outflow", "2.5 +- 0.1", f"{power:.2f}", abs(power - 2.5) <= 0.1)


def buckets() -> Iterator[Row]:
    """Soil carried in a bucket, and tipped out."""
    heaped = transport_soil(SOIL, 2000, fill=1.15)
    yield Row(
        f"heaped bucket ({heaped.fill:.2f} struck), swung: left",
        ">= 0.99",
        f"{heaped.fraction_after_swing:.3f}",
        heaped.fraction_after_swing >= 0.99,
    )
    through = heaped.tunnelled
    for allow_load_locking in (True, False):
        found = transport_soil(SOIL, 2000, allow_load_locking=allow_load_locking)
        through += found.tunnelled
        rides = "rides as one body" if allow_load_locking else "rides grain by grain"
        yield from _carried(f"full bucket ({found.fill:.2f} struck), {rides}", found)
    yield Row("through the bucket's plates", "0", f"{through}", through == 0)


def _carried(name: str, found: TransportResult) -> Iterator[Row]:
    """What became of a bucketful."""
    yield Row(
        f"{name}, swung and stopped: left",
        ">= 0.99",
        f"{found.fraction_after_stop:.3f}",
        found.fraction_after_stop >= 0.99,
    )
    yield Row(
        f"{name}, tipped: half out at [deg]",
        "45 to 90",
        f"{found.half:.0f} (2 % at {found.begins:.0f}, 90 % at {found.most:.0f})",
        45.0 <= found.half <= 90.0,
    )
    yield Row(
        f"{name}, tipped: out between 45 and 90 deg",
        "> 0.5",
        f"{found.between:.3f}",
        found.between > 0.5,
    )
    yield Row(f"{name}, tipped: left", "0", f"{found.left:.3f}", found.left == 0.0)


def scoops(quick: bool) -> Iterator[Row]:
    """Scoops at the top speed of every joint."""
    found = [run_scoop(seed) for seed in range(5 if quick else 100)]
    fast, most = max(one.max_tip_speed for one in found), max(one.max_in_bucket for one in found)
    name = f"{len(found)} scoops at up to {fast:.1f} m/s, up to {most} particles held"
    plates, seen, ground = (
        sum(getattr(one, count) for one in found)
        for count in ("tunnelled", "count_tunnelled", "num_sunk")
    )
    yield Row(
        f"{name}: through plates, through the ground",
        "0, 0",
        f"{max(plates, seen)}, {ground}",
        plates == seen == ground == 0,
    )
    worst = max(one.imbalance for one in found)
    yield Row(f"{name}: soil lost [mm3]", "0", f"{worst}", worst == 0)


def run(quick: bool, results: Results) -> Iterator[Row]:
    """All experiments."""
    yield from buckets()
    yield from scoops(quick)
    yield from hoppers(quick, results)
    yield from heaps(results)
    yield from rests(quick)
    yield from columns(quick, results)


def draw(path: Path, results: Results) -> None:
    """Write a chart: runout, outflow, and poured angles, beside what is expected."""
    figure = new_figure(12.6, 4.3)
    runout, flow, angle = (add_axes(figure, 0.6 + 4.15 * k, 0.6, 3.5, 3.3) for k in range(3))
    _draw_runout(runout, results.collapses)
    _draw_flow(flow, results.flows)
    _draw_angle(angle, results.angles)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)


def _draw_runout(axes: Axes, collapses: dict[str, list[Collapse]]) -> None:
    a = np.linspace(0.3, 3.5, 200)
    laws = {
        "axisymmetric": np.where(a < 1.7, 1.24 * a, 1.6 * np.sqrt(a)),
        "planar": np.where(a < 2.3, 1.2 * a, 1.9 * a ** (2 / 3)),
    }
    for (name, found), colour in zip(collapses.items(), (CUT, FILL), strict=True):
        axes.plot(a, laws[name], color=colour, linewidth=1.0, label=f"{name}, Lube et al.")
        axes.plot([c.aspect for c in found], [c.runout for c in found], "o", color=colour,
                  markersize=5, label=f"{name}, found")  # fmt: skip
    _name(axes, "Runout of a column", "height over radius or length", "runout, in these")


def _draw_flow(axes: Axes, flows: list[Flow]) -> None:
    opening = np.array([flow.opening for flow in flows])
    d = np.linspace(0.9 * opening.min(), 1.1 * opening.max(), 100)
    scale = flows[-1].law / (opening[-1] - 1.4) ** 2.5
    axes.loglog(
        d - 1.4, scale * (d - 1.4) ** 2.5, color=GREY, linewidth=1.0, label="Beverloo et al."
    )
    axes.loglog(opening - 1.4, [flow.rate for flow in flows], "o", color=CUT, markersize=5,
                label=f"found, exponent {flow_exponent(flows):.2f}")  # fmt: skip
    axes.set_xticks(opening - 1.4, [f"{wide:g} - 1.4" for wide in opening])
    axes.minorticks_off()
    _name(axes, "Outflow of a bin", "hole less 1.4, in diameters", "particles/s")


def _draw_angle(axes: Axes, angles: dict[str, tuple[float, float]]) -> None:
    asked, found = np.array(list(angles.values())).T
    ends = np.array([asked.min() - 4.0, asked.max() + 4.0])
    axes.plot(ends, ends, color=GREY, linewidth=1.0, label="as asked")
    axes.fill_between(ends, ends - 2.0, ends + 2.0, color=GREY, alpha=0.15, linewidth=0.0)
    axes.plot(asked, found, "o", color=FILL, markersize=5, label="found")
    for name, x, y in zip(angles, asked, found, strict=True):
        axes.annotate(name, (x, y), xytext=(6, -9), textcoords="offset points", size=SMALL)
    _name(axes, "Angle of a poured heap", "asked [deg]", "found [deg]")


def _name(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, size=LABEL, color=INK, loc="left")
    axes.set_xlabel(x, size=LABEL, color=INK)
    axes.set_ylabel(y, size=LABEL, color=INK)
    axes.legend(fontsize=SMALL, frameon=False)


def main() -> None:
    """Print the table, and draw the chart."""
    parser = argparse.ArgumentParser(prog="benchmarks.validation", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer particles; rough numbers")
    parser.add_argument(
        "--chart", type=Path, metavar="FILE", help="draw a picture, say out/lab.png"
    )
    args = parser.parse_args()
    warm_up()
    results, rows = Results(), []
    begin = time.perf_counter()
    for row in run(args.quick, results):
        rows.append(row)
        print(f"[{time.perf_counter() - begin:5.0f} s] {row.check}: {row.found}", flush=True)
    wide = [max(len(getattr(row, name)) for row in rows) for name in ("check", "expected", "found")]
    print()
    for cells in (("check", "expected", "found", "within"), *_cells(rows)):
        print(" | ".join(f"{cell:<{w}}" for cell, w in zip(cells, [*wide, 6], strict=True)))
    if args.chart:
        draw(args.chart, results)
        print(f"\n{args.chart}")


def _cells(rows: list[Row]) -> Iterator[tuple[str, str, str, str]]:
    for row in rows:
        yield row.check, row.expected, row.found, "yes" if row.within else "NO"


if __name__ == "__main__":
    main()

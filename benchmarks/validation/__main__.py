"""Run all laboratory experiments and compare them with published laws and soil parameters.

    python -m benchmarks.validation                        # a quarter of an hour
    python -m benchmarks.validation --quick                # some minutes, rough numbers
    python -m benchmarks.validation --chart out/lab.png    # draws the results as well

With --quick, flat columns have too few particles: their runout is 30 to 40 % below the law.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.validation.angle_of_repose import poured_repose_angle
from benchmarks.validation.bucket_transport import TransportResult, transport_soil
from benchmarks.validation.chart import Results, draw_chart
from benchmarks.validation.column_collapse import collapse_axisymmetric, collapse_planar
from benchmarks.validation.face_milling import mill_face
from benchmarks.validation.full_speed_scoop import run_scoop
from benchmarks.validation.heap_creep import resting_heap
from benchmarks.validation.hopper_outflow import OPENINGS, flow_exponent, measure_outflow
from benchmarks.validation.plate_tunnelling import sweep_plate
from machine_sim.dem import warm_up
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils.soil_types import load_soil_types

SOIL = LooseSoil(tool_friction=17.0)
"""Soil of all experiments except the poured heaps; its angle of repose is 30 degrees."""
COLUMNS = ((0.5, 100_000), (1.0, 20_000), (2.0, 20_000), (3.0, 20_000))
"""Aspect ratio and number of particles of each column; a flat column needs more particles to be
several of them high."""
NUM_QUICK_PARTICLES = 5000
"""Number of particles of a column with `--quick`."""
POURED_SOILS = ("reference", "dry sand", "gravel", "wet clay")
SHAPES = {"axisymmetric": collapse_axisymmetric, "planar": collapse_planar}


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        quantity: the quantity.
        expected: its expected value and bound.
        measured: its measured value.
        is_within: whether the measured value is within the bound.
    """

    quantity: str
    expected: str
    measured: str
    is_within: bool


def check_columns(quick: bool, results: Results) -> Iterator[Row]:
    """Collapse columns of two shapes and several aspect ratios."""
    for name, collapse in SHAPES.items():
        results.collapses[name] = []
        for aspect, num_particles in COLUMNS:
            count = NUM_QUICK_PARTICLES if quick else num_particles
            result = collapse(SOIL, aspect, count, capacity=count)
            results.collapses[name].append(result)
            yield Row(
                f"runout of a column, {name}, aspect {result.aspect:.2f}, {count} particles",
                f"{result.expected_runout:.2f} +- 15 %",
                f"{result.runout:.2f} ({100.0 * (result.ratio - 1.0):+.0f} %)",
                abs(result.ratio - 1.0) <= 0.15,
            )


def check_heaps(results: Results) -> Iterator[Row]:
    """Pour heaps of shipped soils at their shipped moisture."""
    soil_types = load_soil_types()
    for name in POURED_SOILS:
        soil_type = soil_types[name]
        expected = math.degrees(soil_type.repose_angle_at(soil_type.moisture))
        measured = poured_repose_angle(soil_type.loose_soil, 4000, moisture=soil_type.moisture)
        results.angles[name] = expected, measured
        yield Row(
            f"poured angle of {name} [deg]",
            f"{expected:.1f} +- 2",
            f"{measured:.1f}",
            abs(measured - expected) <= 2.0,
        )


def check_rest(quick: bool) -> Iterator[Row]:
    """Measure the motion of a heap at rest, with all particles awake."""
    duration = 20.0 if quick else 60.0
    result = resting_heap(SOIL, 5000, duration=duration, allow_sleeping=False)
    yield Row(
        f"energy of a heap after {duration:g} s [weight x diameter]",
        "< 1e-8",
        f"{result.energy:.1e}",
        result.energy < 1e-8,
    )
    yield Row(
        f"creep of a heap in {duration:g} s [diameters]",
        "< 1e-3",
        f"{result.creep:.1e}",
        result.creep < 1e-3,
    )


def check_hoppers(quick: bool, results: Results) -> Iterator[Row]:
    """Measure the outflow of bins with holes of several sizes."""
    for opening in OPENINGS:
        flow = measure_outflow(SOIL, opening, passing=2000 if quick else 8000)
        results.flows.append(flow)
        yield Row(
            f"outflow through {opening:g} diameters [particles/s]",
            f"{flow.expected_rate:.0f} +- 25 %",
            f"{flow.rate:.0f} (+- {100.0 * flow.error:.1f} %)",
            abs(flow.rate / flow.expected_rate - 1.0) <= 0.25,
        )
    exponent = flow_exponent(results.flows)
    yield Row("exponent of outflow", "2.5 +- 0.15", f"{exponent:.2f}", abs(exponent - 2.5) <= 0.15)


def check_buckets() -> Iterator[Row]:
    """Transport soil in a bucket and tip it."""
    heaped = transport_soil(SOIL, 2000, fill=1.15)
    yield Row(
        f"heaped bucket (fill {heaped.fill:.2f} struck), fraction after swing",
        ">= 0.99",
        f"{heaped.fraction_after_swing:.3f}",
        heaped.fraction_after_swing >= 0.99,
    )
    num_tunnelled = heaped.num_tunnelled
    for allow_load_locking in (True, False):
        result = transport_soil(SOIL, 2000, allow_load_locking=allow_load_locking)
        num_tunnelled += result.num_tunnelled
        mode = "with load locking" if allow_load_locking else "without load locking"
        yield from _transport_rows(f"full bucket (fill {result.fill:.2f} struck), {mode}", result)
    yield Row(
        "particles through the plates of a bucket", "0", f"{num_tunnelled}", num_tunnelled == 0
    )


def _transport_rows(name: str, result: TransportResult) -> Iterator[Row]:
    """Yield the rows of one transport."""
    yield Row(
        f"{name}, fraction after swing and stop",
        ">= 0.99",
        f"{result.fraction_after_stop:.3f}",
        result.fraction_after_stop >= 0.99,
    )
    yield Row(
        f"{name}, tilt with half of the soil out [deg]",
        "45 to 90",
        f"{result.tilt_at_half:.0f} (2 % at {result.tilt_at_2_percent:.0f},"
        f" 90 % at {result.tilt_at_90_percent:.0f})",
        45.0 <= result.tilt_at_half <= 90.0,
    )
    yield Row(
        f"{name}, fraction out between 45 and 90 deg",
        "> 0.5",
        f"{result.fraction_out_45_to_90:.3f}",
        result.fraction_out_45_to_90 > 0.5,
    )
    yield Row(
        f"{name}, fraction after tipping",
        "0",
        f"{result.final_fraction:.3f}",
        result.final_fraction == 0.0,
    )


def check_scoops(quick: bool) -> Iterator[Row]:
    """Scoop at the maximum speed of every joint."""
    results = [run_scoop(seed) for seed in range(5 if quick else 100)]
    max_speed = max(result.max_tip_speed for result in results)
    max_particles = max(result.max_in_bucket for result in results)
    name = f"{len(results)} scoops at up to {max_speed:.1f} m/s, up to {max_particles} particles"
    num_engine = sum(result.num_plate_tunnellings for result in results)
    num_crossings = sum(result.num_crossings for result in results)
    num_ground = sum(result.num_ground_tunnellings for result in results)
    yield Row(
        f"{name}: through plates, through the ground",
        "0, 0",
        f"{max(num_engine, num_crossings)}, {num_ground}",
        num_engine == num_crossings == num_ground == 0,
    )
    imbalance = max(result.imbalance for result in results)
    yield Row(f"{name}: volume imbalance [mm3]", "0", f"{imbalance}", imbalance == 0)


def check_plates() -> Iterator[Row]:
    """Strike small particles with a plate at the speed of the fastest lip and at twice that."""
    for speed in (11.0, 22.0):
        for radius in (0.021, 0.012, 0.006, 0.003):
            num_crossings = sum(sweep_plate(radius, speed, seed) for seed in range(5))
            yield Row(
                f"1000 particles of {1e3 * radius:g} mm radius through a plate at {speed:g} m/s",
                "0",
                f"{num_crossings}",
                num_crossings == 0,
            )


def check_milling() -> Iterator[Row]:
    """Cut a face of rock and one of loam with the road header."""
    (rock, rock_time), (loam, loam_time) = mill_face("rock"), mill_face("loam")
    yield Row(
        "face of rock: work of the drive without counterpart [%]",
        "0 +- 5",
        f"{100.0 * rock.imbalance:.1f}",
        abs(rock.imbalance) < 0.05,
    )
    yield Row(
        "face of rock: milling rate [m3/h]", "20 to 60", f"{rock.rate:.0f}", 20.0 < rock.rate < 60.0
    )
    yield Row(
        "face of loam: time over that of rock",
        "< 0.5",
        f"{loam_time / rock_time:.2f}",
        loam_time < 0.5 * rock_time,
    )
    yield Row(
        "face of loam: work against cuttings over work of milling",
        "< 0.5",
        f"{loam.cuttings_work / loam.milling_work:.2f}",
        loam.cuttings_work < 0.5 * loam.milling_work,
    )


def run_all(quick: bool, results: Results) -> Iterator[Row]:
    """Run all experiments."""
    yield from check_buckets()
    yield from check_scoops(quick)
    yield from check_plates()
    yield from check_milling()
    yield from check_hoppers(quick, results)
    yield from check_heaps(results)
    yield from check_rest(quick)
    yield from check_columns(quick, results)


def print_table(rows: list[Row]) -> None:
    """Print all rows in aligned columns."""
    lines = [("quantity", "expected", "measured", "within")]
    lines += [
        (row.quantity, row.expected, row.measured, "yes" if row.is_within else "NO") for row in rows
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print(" | ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True)))


def main() -> None:
    """Run all experiments, print the table, and draw the chart."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.validation", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--quick", action="store_true", help="fewer particles, rough numbers")
    parser.add_argument("--chart", type=Path, metavar="FILE", help="file to draw the results into")
    options = parser.parse_args()
    warm_up()
    results, rows = Results(), []
    start = time.perf_counter()
    for row in run_all(options.quick, results):
        rows.append(row)
        seconds = time.perf_counter() - start
        print(f"[{seconds:5.0f} s] {row.quantity}: {row.measured}", flush=True)
    print()
    print_table(rows)
    if options.chart:
        draw_chart(options.chart, results)
        print(f"\n{options.chart}")


if __name__ == "__main__":
    main()

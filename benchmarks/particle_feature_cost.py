"""Measure the cost of each feature of the particles: size spread, cohesion, growth, sleep.

    python -m benchmarks.particle_feature_cost     # about two minutes

The same block falls to a heap, or is swung in a bucket, with plain soil and with one feature at a
time. Plain soil has no cohesion, and its lumps have one size, do not grow, and are kept awake.
Printed are the wall time per particle and 5 ms step (medians of interleaved runs), the difference
from plain soil, and the mean number of contacts of a particle of the heap, because a feature also
changes the heap. Rotation of the particles cannot be switched off and is not listed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.particle_scenes import (
    FALLING_STEPS,
    REST_GROUP,
    REST_GROUPS,
    VOLUME,
    add_block,
    flat_ground,
    measure_heap,
    settle_steps,
    step_untimed,
    time_bucket,
    time_steps,
)
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import interleave
from machine_sim.dem import ParticleEngine, ParticleParams, warm_up
from msg_bridge.contract.loose_soil import LooseSoil

COUNT = 5000
RUNS = 5
SPACING = 0.11
"""Spacing of the lumps of a block [m], wide enough for the largest lump."""

COLUMNS = (
    *(Column("falling", "us"), Column("settled", "us"), Column("in a bucket", "us")),
    Column("contacts", "", ".1f"),
)

PLAIN = LooseSoil()
COHESIVE = LooseSoil(cohesion=15_000.0, adhesion=8000.0, moisture=100)
"""Soil with the cohesion and adhesion of wet clay and the angles of plain soil: cohesion is the
only cause of differences in the heap."""


@dataclass(frozen=True)
class Feature:
    """Soil that differs from plain soil in one feature.

    Attributes:
        name: name in the table.
        soil: the soil, including its moisture.
        grow: whether particles start small and grow, as when a machine digs them.
        params: parameters of the particles that differ from those of plain soil.
    """

    name: str
    soil: LooseSoil = PLAIN
    grow: bool = False
    params: dict[str, bool] = field(default_factory=dict)

    def make_engine(self) -> ParticleEngine:
        """Return an engine over level ground."""
        params = ParticleParams.from_mapping(
            {"capacity": 10**6, "allow_sleeping": False, **self.params}
        )
        return ParticleEngine(params, flat_ground(), soils=[self.soil])

    def draw_volumes(self, count: int) -> NDArray[np.int64]:
        """Return bank volumes [mm^3], uniform over the size spread, as release draws them."""
        deviation = self.soil.size_spread * np.random.default_rng(3).uniform(-1.0, 1.0, count)
        return np.rint(VOLUME * (1.0 + deviation)).astype(np.int64)


FEATURES = (
    Feature("plain"),
    Feature("sizes +-40 %", LooseSoil(size_spread=0.4)),
    Feature("sizes +-70 %", LooseSoil(size_spread=0.7)),
    Feature("cohesive", COHESIVE),
    Feature("growing at first", grow=True),
    Feature("sleep", params={"allow_sleeping": True}),
    Feature(
        "all of these",
        replace(COHESIVE, size_spread=0.7),
        grow=True,
        params={"allow_sleeping": True},
    ),
)


def measure_feature(feature: Feature, count: int) -> tuple[float, float, float, float]:
    """Return times while falling, settled and in a bucket [us per particle and step], and contacts.

    Contacts are the mean number per particle of the settled heap.
    """
    soil, volume = feature.soil, feature.draw_volumes(count)
    engine = feature.make_engine()
    add_block(engine, count, volume, spacing=SPACING, moisture=soil.moisture, grow=feature.grow)
    falling = time_steps(engine, FALLING_STEPS, group=FALLING_STEPS)
    step_untimed(engine, settle_steps(count))
    settled = time_steps(engine, REST_GROUP * REST_GROUPS, group=REST_GROUP)
    heap = measure_heap(engine.positions, engine.radii)
    in_bucket = time_bucket(
        feature.make_engine(),
        count,
        volume,
        spacing=SPACING,
        moisture=soil.moisture,
        grow=feature.grow,
    )
    scale = 1e3 / count
    return scale * falling, scale * settled, scale * in_bucket, heap.contacts


def main() -> None:
    """Measure and print the table."""
    parser = make_parser(__doc__, runs=RUNS)
    parser.add_argument("--count", type=int, default=COUNT, help=f"number of particles ({COUNT})")
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json, row_width=18, width=18)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    warm_up()
    for feature in FEATURES:
        measure_feature(feature, 50)
    cases = [partial(measure_feature, feature, options.count) for feature in FEATURES]
    medians = np.median(interleave(cases, options.runs), axis=0).tolist()
    table.print_note(
        f"{options.count} particles, us per particle and 5 ms step (difference from plain)"
    )
    table.print_header()
    plain = medians[0]
    for feature, values in zip(FEATURES, medians, strict=True):
        texts = [
            f"{value:.3f} ({100 * (value / reference - 1):+.0f} %)"
            for value, reference in zip(values[:-1], plain[:-1], strict=True)
        ]
        table.print_row(feature.name, values, texts=[*texts, None])


if __name__ == "__main__":
    main()

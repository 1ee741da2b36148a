"""What each feature of the particles costs: sizes that vary, soil that sticks, growth, sleep.

The same block falls to a heap, or is swung in a bucket, plain and with one feature at a time.
Plain is soil without cohesion in lumps of one size that have it from the start, and that are kept
awake. Printed is the wall time per particle and 5 ms step, the median of runs that take turns, and
how much more than plain that is; then how many contacts a particle of the heap has, for a feature
also costs what it changes in the heap. That spheres turn is no feature that could be left out.

Run from the repository root: `python benchmarks/particle_feature_cost.py`; takes about two minutes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from particle_scenes import (
    FALLING,
    VOLUME,
    add_block,
    describe_load,
    flat_ground,
    measure_heap,
    run,
    settle_steps,
    time_bucket,
    time_steps,
)

from machine_sim.dem import ParticleEngine, ParticleParams, warm_up
from msg_bridge.contract.loose_soil import LooseSoil

COUNT = 5000
RUNS = 5
GROUP, GROUPS = 20, 5
"""Steps of a heap at rest that are timed together, and how often."""
SPACING = 0.11
"""Of the lumps of a block [m]: room for the largest."""
COLUMNS = ("falling", "settled", "in a bucket")

PLAIN = LooseSoil()
STICKY = LooseSoil(cohesion=15_000.0, adhesion=8000.0, moisture=100)
"""With the cohesion and adhesion of wet clay, but the angles of plain soil: of what differs in the
heap, only sticking is the cause."""


@dataclass(frozen=True)
class Feature:
    """One way of being not plain.

    Attributes:
        name: as printed.
        soil: its moisture counts.
        grow: whether particles start small, as when a machine digs them.
        params: that differ from the plain ones.
    """

    name: str
    soil: LooseSoil = PLAIN
    grow: bool = False
    params: dict[str, bool] = field(default_factory=dict)

    def engine(self) -> ParticleEngine:
        """An engine over level ground."""
        params = ParticleParams.from_mapping(
            {"capacity": 10**6, "allow_sleeping": False, **self.params}
        )
        return ParticleEngine(params, flat_ground(), soils=[self.soil])

    def volumes(self, count: int) -> NDArray[np.int64]:
        """Bank volume of each particle [mm^3], even over the range, as they are released."""
        off = self.soil.size_spread * np.random.default_rng(3).uniform(-1.0, 1.0, count)
        return np.rint(VOLUME * (1.0 + off)).astype(np.int64)


FEATURES = (
    Feature("plain"),
    Feature("sizes +-40 %", LooseSoil(size_spread=0.4)),
    Feature("sizes +-70 %", LooseSoil(size_spread=0.7)),
    Feature("wet, sticky", STICKY),
    Feature("growing at first", grow=True),
    Feature("sleep", params={"allow_sleeping": True}),
    Feature(
        "all of these", replace(STICKY, size_spread=0.7), grow=True, params={"allow_sleeping": True}
    ),
)


def cost(feature: Feature, count: int) -> tuple[float, float, float, float]:
    """Falling, settled and in a bucket [us per particle and step], and contacts of each."""
    soil, volume = feature.soil, feature.volumes(count)
    engine = feature.engine()
    add_block(engine, count, volume, spacing=SPACING, moisture=soil.moisture, grow=feature.grow)
    falling = time_steps(engine, FALLING, group=FALLING)
    run(engine, settle_steps(count))
    settled = time_steps(engine, GROUP * GROUPS, group=GROUP)
    heap = measure_heap(engine.positions, engine.radii)
    swung = time_bucket(
        feature.engine(), count, volume, spacing=SPACING, moisture=soil.moisture, grow=feature.grow
    )
    scale = 1e3 / count
    return scale * falling, scale * settled, scale * swung, heap.contacts


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=COUNT, help="particles")
    options.add_argument("--runs", type=int, default=RUNS, help="of each; medians are printed")
    given = options.parse_args()
    print(f"{describe_load()}; medians of {given.runs} runs")
    warm_up()
    for feature in FEATURES:
        cost(feature, 50)
    runs = [[cost(feature, given.count) for feature in FEATURES] for _ in range(given.runs)]
    table = np.median(runs, axis=0)
    print(f"{given.count} particles, us per particle and 5 ms step (over plain)")
    print(f"{'':<18}" + "".join(f"{name:>18}" for name in COLUMNS) + f"{'contacts':>10}")
    for feature, (*costs, contacts) in zip(FEATURES, table, strict=True):
        cells = (
            f"{own:>9.3f} ({100 * (own / plain - 1):+4.0f} %)"
            for own, plain in zip(costs, table[0], strict=False)
        )
        print(f"{feature.name:<18}" + "".join(cells) + f"{contacts:>10.1f}")


if __name__ == "__main__":
    main()

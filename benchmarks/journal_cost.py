"""Measure what crash recovery costs: the journal of each tick, and the checkpoints.

    python -m benchmarks.journal_cost

An excavator digs, lifts, swings and dumps on a site of the demo's size, without DDS, whose share of
a tick would make that of the journal smaller. Runs with and without recovery alternate. The part of
the journal is measured within a tick, so that it does not depend on the noise between runs.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.real_time_load import DigScript
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import interleave
from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams
from machine_sim.machine import load_machine_spec
from machine_sim.node.machine_instance import create_machine_instances
from machine_sim.node.machine_journal import MachineJournal, MachineRunBegin
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.params import MachineNodeParams
from machine_sim.params import MachineSimParams
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.config_files import find_config
from msg_bridge.contract.messages import Keyframe
from msg_bridge.recovery.run_journal import RunJournal
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_journal import SoilJournal
from soil_sim.node.soil_run import SoilRun
from soil_sim.site.site import SiteParams, make_site
from soil_sim.soils.params import SoilParams

NUM_TICKS = 2400
"""Ticks of a run: three dig cycles."""
NUM_UNMEASURED = 100
"""First ticks, in which kernels are compiled or loaded."""
CHECKPOINT_PERIOD = 5.0
"""Wall time between two checkpoints, the default [s]."""


class Cost(NamedTuple):
    """Mean wall times of a tick [ms].

    Attributes:
        soil, machine: the tick of the node.
        soil_journal, machine_journal: the journal's part of it.
        checkpoints: the part of both in which checkpoints are captured.
        kilobytes: size of the journal per tick [kB], both nodes.
    """

    soil: float
    machine: float
    soil_journal: float
    machine_journal: float
    checkpoints: float
    kilobytes: float


class Stopwatch:
    """Wall time in the calls of functions [s]."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function whose calls are timed here."""

        def call(*args: Any, **options: Any) -> Any:
            start = time.perf_counter()
            result = function(*args, **options)
            self.seconds += time.perf_counter() - start
            return result

        return call


def replace_by_timed(owner: Any, name: str, stopwatch: Stopwatch) -> None:
    """Replace the method `name` of an object: its calls are timed."""
    setattr(owner, name, stopwatch.timed(getattr(owner, name)))


def main() -> None:
    """Measure and print."""
    options = make_parser(__doc__, runs=5).parse_args()
    table = ResultTable(
        [Column("without"), Column("with"), Column("journal"), Column("share", "%", ".1f")],
        as_json=options.json,
    )
    run_dig(Path(), with_journal=False)
    with tempfile.TemporaryDirectory() as folder:
        runs = [partial(run_dig, Path(folder), with_journal=each) for each in (False, True)]
        without, with_journal = (
            Cost(*map(statistics.median, zip(*costs, strict=True)))
            for costs in zip(*interleave(runs, options.runs), strict=True)
        )
    table.print_note(f"{describe_load()}; medians of {options.runs} runs, ms per tick")
    table.print_header()
    for name in ("soil", "machine"):
        tick, cost = getattr(with_journal, name), getattr(with_journal, f"{name}_journal")
        share = 100.0 * cost / (tick - cost)
        table.print_row(name, [getattr(without, name), tick, cost, share])
    table.print_note(
        f"checkpoints every {CHECKPOINT_PERIOD:g} s: {with_journal.checkpoints:.4f} ms per tick;"
        f" journal: {with_journal.kilobytes:.1f} kB per tick"
    )


def run_dig(folder: Path, *, with_journal: bool) -> Cost:
    """Return the cost of a run."""
    journals: list[RunJournal] = []
    if with_journal:
        journals = [RunJournal(folder / name, CHECKPOINT_PERIOD) for name in ("soil", "machine")]
    watches = {name: Stopwatch() for name in Cost._fields}
    soil_journal, machine_journal = (
        SoilJournal(journals[0] if journals else None),
        MachineJournal(journals[1] if journals else None),
    )
    replace_by_timed(soil_journal, "record_tick", watches["soil_journal"])
    replace_by_timed(machine_journal, "record_tick", watches["machine_journal"])
    for journal in (soil_journal, machine_journal):
        replace_by_timed(journal, "checkpoint_if_due", watches["checkpoints"])
    spec = load_machine_spec(find_config("machines/excavator.yaml"))
    soil, machine = _nodes(soil_journal, machine_journal)
    soil_tick = watches["soil"].timed(partial(_soil_tick, soil))
    machine_tick = watches["machine"].timed(partial(_machine_tick, machine))
    script = DigScript(spec)
    machine.join()
    for tick in range(NUM_TICKS):
        if tick == NUM_UNMEASURED:
            for watch in watches.values():
                watch.seconds = 0.0
        machine.schedulers[0].arbiter.receive_joints(
            ["swing", "boom", "arm", "bucket"], None, script.goal(0.01 * tick), 0.01 * tick
        )
        machine_tick()
        for message in machine.endpoint.drain_outbox():
            soil.endpoint.receive(message)
        soil_tick()
        for message in soil.endpoint.drain_outbox():
            machine.endpoint.receive(message)
    size = sum(path.stat().st_size for path in folder.rglob("inputs_*"))
    machine.close()
    for each in journals:
        each.end()
        each.close()
    num_ticks = NUM_TICKS - NUM_UNMEASURED
    milliseconds = {name: 1e3 * watch.seconds / num_ticks for name, watch in watches.items()}
    return Cost(**{**milliseconds, "kilobytes": 1e-3 * size / NUM_TICKS})


def _soil_tick(soil: SoilRun) -> None:
    soil.advance(0.0)
    soil.checkpoint_if_due()


def _machine_tick(machine: MachineRun) -> None:
    machine.endpoint.poll()
    if machine.endpoint.is_ready:
        machine.apply_commands(0.0)
        machine.step()
        machine.checkpoint_if_due()


def _nodes(
    soil_journal: SoilJournal, machine_journal: MachineJournal
) -> tuple[SoilRun, MachineRun]:
    """Return soil and machine as their nodes make them."""
    params = SoilNodeParams(sync="lockstep")
    site = make_site(SiteParams(num_points=257, cell=0.2))
    soil = SoilRun(site, SoilParams(), params, run_id=1, journal=soil_journal)
    soil_journal.begin(1, "")
    terrain = soil.endpoint.soil
    facts = RunFacts(1, params.tick_period, False, terrain.grid.cell, terrain.loose_soils)
    keyframe = Keyframe(1, 0, terrain.grid, terrain.columns.height.copy(), *terrain.layers)
    node = MachineNodeParams()
    instances = create_machine_instances({"": node}, "kinematic", CommandParams())
    machine = MachineRun(
        instances,
        node,
        MachineSimParams(),
        ParticleParams(),
        facts,
        keyframe,
        session_id=1,
        journal=machine_journal,
    )
    machine_journal.begin(MachineRunBegin(facts, keyframe, 1, ""))
    return soil, machine


if __name__ == "__main__":
    main()

"""Audits of runs in which the soil went on without a late machine, dropped it, or released it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.recorded_exchange import scripted_run

from msg_bridge.audit.bag_audit import audit_bag, audit_run
from msg_bridge.audit.collect import RunData
from msg_bridge.audit.report import Check, RunReport
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    MachineReceipt,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    MAP_UPDATE,
    ConversionKind,
    empty_rows,
)

START = 4000


class Script:
    """A run on 2 x 2 columns of 1000 mm3, written down tick by tick."""

    def __init__(self) -> None:
        self.data = RunData()
        self.cells = np.full((2, 2), 1000, dtype=np.int64)
        self._conversions = 0
        self._revision = 0
        self.keyframe()

    def soil(
        self, *moved: tuple[int, int, int], receipt: MachineReceipt | None, **ledger: int
    ) -> None:
        """A tick that moved (kind, particle, volume), each in a column of its own."""
        tick = len(self.data.soil)
        rows, map_updates = empty_rows(CONVERSION, len(moved)), empty_rows(MAP_UPDATE, len(moved))
        self._revision += bool(moved)
        for n, (kind, particle, volume) in enumerate(moved):
            self._conversions += 1
            for each in (rows, map_updates):
                each["seq"][n] = self._conversions
                each["col"][n] = n
            rows["kind"][n], rows["particle_id"][n], rows["volume_mm3"][n] = kind, particle, volume
            rows["machine_id"][n], rows["tick"][n] = 1, tick
            self.cells[0, n] += volume if kind == ConversionKind.DEPOSIT else -volume
            map_updates["volume_mm3"][n], map_updates["revision"][n] = (
                self.cells[0, n],
                self._revision,
            )
        span = RowRange(self._conversions + 1 - len(moved), len(moved))
        receipts = () if receipt is None else (receipt,)
        header = SoilHeader(1, tick, self._revision, span, span, RowRange(), receipts)
        self.data.soil[tick] = header
        self.data.chunks[Stream.CONVERSION, 0, 0].append(rows)
        self.data.chunks[Stream.MAP_UPDATE, 0, 0].append(map_updates)
        names = ("in_flight", "pending", "particles", "absent", "outside")
        accounts = {name: ledger.get(name, 0) for name in names}
        self.data.ledgers[tick] = Ledger(
            tick=tick, terrain=int(self.cells.sum()), start=START, **accounts
        )
        assert self.data.ledgers[tick].imbalance == 0

    def machine(
        self, session_id: int, tick: int, verb: Verb, received: int, pending: int, particles: int
    ) -> None:
        header = MachineHeader(
            1,
            1,
            session_id,
            tick,
            verb,
            RowRange(),
            RowRange(),
            received,
            received,
            pending,
            particles,
        )
        if verb in (Verb.JOIN, Verb.REJOIN):
            self.data.joins[1, session_id] = header
        else:
            self.data.steps.setdefault((1, session_id), {})[tick] = header

    def lands(self, tick: int, particle: int, volume: int) -> None:
        """The first row that life 1 lands, of its header of a tick."""
        rows = empty_rows(DEPOSIT_REQUEST, 1)
        rows["machine_id"] = rows["seq"] = 1
        rows["particle_id"], rows["volume_mm3"] = particle, volume
        self.data.chunks[Stream.DEPOSIT_REQUEST, 1, 1].append(rows)
        steps = self.data.steps[1, 1]
        for each, header in steps.items():
            first, count = (1, 1) if each == tick else (1 if each < tick else 2, 0)
            steps[each] = MachineHeader(
                *(1, 1, 1, each, header.verb, RowRange(), RowRange(first, count)),
                *(header.conversions_received, header.conversions_durable),
                *(header.pending_mm3, header.particles_mm3),
            )

    def keyframe(self) -> None:
        grid = Grid(2, 2, 0.2)
        frame = Keyframe(1, self._revision, grid, np.zeros(grid.shape), self.cells.copy())
        self.data.keyframes.add(TerrainMap(frame, np.zeros(grid.shape)))

    def audit(self) -> RunReport:
        self.keyframe()
        return audit_run(1, self.data)


def until_dropped() -> Script:
    """Its tick 2 is taken in the soil's tick 3; from tick 4 on it is dropped, holding 100 mm3."""
    script = Script()
    script.machine(1, -1, Verb.JOIN, 0, 0, 0)
    script.soil(receipt=MachineReceipt(1, 1, 0, 0, tick=0))
    script.machine(1, 1, Verb.STEP, 0, 0, 0)
    script.soil(
        (ConversionKind.EXCAVATE, 0, 100), receipt=MachineReceipt(1, 1, 0, 0, tick=1), in_flight=100
    )
    script.soil(receipt=MachineReceipt(1, 1, 0, 0, tick=1), in_flight=100)
    script.machine(1, 2, Verb.STEP, 1, 40, 60)
    script.lands(2, particle=1, volume=60)
    held = {"pending": 40, "particles": 60}
    receipt = MachineReceipt(1, 1, 1, 1, tick=2)
    script.soil((ConversionKind.DEPOSIT, 1, 60), receipt=receipt, in_flight=-60, **held)
    script.machine(1, 3, Verb.STEP, 2, 40, 0)  # too late: never taken
    script.soil(receipt=None, in_flight=-60, absent=100)
    return script


def returned() -> Script:
    """It comes back in tick 5 with what it held, is owed one row, and goes on."""
    script = until_dropped()
    script.machine(2, 3, Verb.REJOIN, 1, 40, 60)
    backlog = script.data.chunks[Stream.CONVERSION, 0, 0][3].copy()
    backlog["seq"] = 1
    script.data.chunks[Stream.BACKLOG, 1, 2].append(backlog)
    receipt = MachineReceipt(1, 2, 0, 0, backlog=1, tick=5)
    script.soil(receipt=receipt, in_flight=-60, pending=40, particles=60)
    script.machine(2, 6, Verb.STEP, 2, 40, 0)
    script.soil(receipt=MachineReceipt(1, 2, 0, 0, tick=6), pending=40)
    return script


def released() -> Script:
    """What it left, less what had landed already, is put down in tick 5."""
    script = until_dropped()
    script.soil((ConversionKind.DEPOSIT, 0, 40), receipt=None)
    return script


@pytest.mark.parametrize("timeline", [until_dropped, returned, released])
def test_late_dropped_returned_and_released_machines_balance(
    timeline: Callable[[], Script],
) -> None:
    report = timeline().audit()
    assert report.passed, (report.findings, report.unchecked)
    assert report.max_imbalance_mm3 == 0
    assert report.audited == report.recorded


def test_late_machines_of_a_real_exchange_balance(tmp_path: Path) -> None:
    run = scripted_run(3)
    for tick in range(60):
        run.step(late=[n for n in (1, 2, 3) if (tick // n) % 4 == 3])
    run.keyframe()
    report = audit_bag(run.recording.write(tmp_path / "a.mcap"))
    assert report.passed, report.runs[0].findings
    (run_id,) = report.runs
    assert run_id.rows["DEPOSIT_REQUEST"] > 100


def test_machines_dropped_and_released_by_a_real_exchange_balance(tmp_path: Path) -> None:
    run = scripted_run(3)
    for _ in range(30):
        run.step()
    for machine_id in (2, 3):
        run.soil_endpoint.drop(machine_id)
        run.step()
    for _ in range(3):
        run.step()
    left = run.soil_endpoint.ledger
    assert left is not None
    run.rejoin(2, **run.simulated_machines[2].totals)
    for _ in range(5):
        run.step()
    volume = run.release(3, pieces=3)
    for _ in range(5):
        run.step()
    run.keyframe()
    report = audit_bag(run.recording.write(tmp_path / "a.mcap"))
    assert report.passed, report.runs[0].findings
    assert report.runs[0].moved_mm3["RELEASED"] == volume > 0
    assert left.absent > 0
    assert run.soil_endpoint.ledger is not None
    assert run.soil_endpoint.ledger.absent == 0


def test_soil_released_is_told_apart_from_soil_that_landed() -> None:
    assert released().audit().moved_mm3["RELEASED"] == 40
    assert returned().audit().moved_mm3["RELEASED"] == 0


def test_one_mm3_released_too_much_is_found() -> None:
    script = until_dropped()
    script.soil((ConversionKind.DEPOSIT, 0, 40), receipt=None)
    script.data.chunks[Stream.CONVERSION, 0, 0][-1]["volume_mm3"] += 1
    found = {finding.check for finding in script.audit().findings}
    assert Check.TERRAIN in found
    assert Check.LEDGER in found


def test_a_row_owed_that_is_no_copy_is_found() -> None:
    script = returned()
    script.data.chunks[Stream.BACKLOG, 1, 2][0]["volume_mm3"] += 1
    (finding,) = script.audit().findings
    assert finding.check is Check.BACKLOG


def test_a_machine_that_returns_with_other_soil_than_it_left_with_is_named() -> None:
    script = returned()
    script.machine(2, 3, Verb.REJOIN, 1, 40, 61)
    texts = [f.text for f in script.audit().findings if f.check is Check.ACCOUNTS]
    assert any(
        "machine 1 on its return before tick 5 holds 1 mm3 too much" in text for text in texts
    )


def test_a_header_that_the_soil_took_late_and_the_bag_lacks_is_a_gap() -> None:
    script = until_dropped()
    del script.data.steps[1, 1][2]
    texts = [finding.text for finding in script.audit().completeness_findings]
    assert any(text == "machine 1's header of tick 2 is missing" for text in texts)


def test_an_answer_in_another_tick_than_the_landing_was_taken_is_found() -> None:
    script = until_dropped()
    late = script.data.soil[3].receipts[0]
    header = script.data.soil[2]
    spoilt = SoilHeader(1, 2, 1, header.conversions, header.map_updates, RowRange(), (late,))
    script.data.soil[2] = spoilt
    texts = [f.text for f in script.audit().findings if f.check is Check.DEPOSIT_REQUESTS]
    assert texts == ["machine 1's particle 1 landed in tick 2 and was answered in tick 3"]

"""Runs in which the soil did not wait for a machine, dropped it, or released its soil."""

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
    """A run on 2 x 2 columns of 1000 mm3, built tick by tick."""

    def __init__(self) -> None:
        self.data = RunData()
        self.cells = np.full((2, 2), 1000, dtype=np.int64)
        self._conversions = 0
        self._revision = 0
        self.keyframe()

    def soil(
        self, *moved: tuple[int, int, int], receipt: MachineReceipt | None, **ledger: int
    ) -> None:
        """Add a soil tick with conversions (kind, particle, volume), each in another column."""
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
            run_id=1, tick=tick, terrain=int(self.cells.sum()), start=START, **accounts
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
            pending,
            particles,
        )
        if verb in (Verb.JOIN, Verb.REJOIN):
            self.data.joins[1, session_id] = header
        else:
            self.data.steps.setdefault((1, session_id), {})[tick] = header

    def add_deposit_request(self, tick: int, particle: int, volume: int) -> None:
        """Add the first deposit request of session 1 to its header of a tick."""
        rows = empty_rows(DEPOSIT_REQUEST, 1)
        rows["machine_id"] = rows["seq"] = 1
        rows["particle_id"], rows["volume_mm3"] = particle, volume
        self.data.chunks[Stream.DEPOSIT_REQUEST, 1, 1].append(rows)
        steps = self.data.steps[1, 1]
        for each, header in steps.items():
            first, count = (1, 1) if each == tick else (1 if each < tick else 2, 0)
            steps[each] = MachineHeader(
                *(1, 1, 1, each, header.verb, RowRange(), RowRange(first, count)),
                *(header.conversions_received, header.pending_mm3, header.particles_mm3),
            )

    def keyframe(self) -> None:
        grid = Grid(2, 2, 0.2)
        frame = Keyframe(1, self._revision, grid, np.zeros(grid.shape), self.cells.copy())
        self.data.keyframes.add(TerrainMap(frame, np.zeros(grid.shape)))

    def audit(self) -> RunReport:
        self.keyframe()
        return audit_run(1, self.data)


def until_dropped() -> Script:
    """Its tick 2 is accepted in the soil's tick 3; it is dropped in tick 4 with 100 mm3."""
    script = Script()
    script.machine(1, -1, Verb.JOIN, 0, 0, 0)
    script.soil(receipt=MachineReceipt(1, 1, 0, tick=0))
    script.machine(1, 1, Verb.STEP, 0, 0, 0)
    script.soil(
        (ConversionKind.EXCAVATE, 0, 100), receipt=MachineReceipt(1, 1, 0, tick=1), in_flight=100
    )
    script.soil(receipt=MachineReceipt(1, 1, 0, tick=1), in_flight=100)
    script.machine(1, 2, Verb.STEP, 1, 40, 60)
    script.add_deposit_request(2, particle=1, volume=60)
    soil = {"pending": 40, "particles": 60}
    receipt = MachineReceipt(1, 1, 1, tick=2)
    script.soil((ConversionKind.DEPOSIT, 1, 60), receipt=receipt, in_flight=-60, **soil)
    script.machine(1, 3, Verb.STEP, 2, 40, 0)  # too late: never accepted
    script.soil(receipt=None, in_flight=-60, absent=100)
    return script


def rejoined() -> Script:
    """It rejoins in tick 5 with its soil and a backlog of one row, and continues."""
    script = until_dropped()
    script.machine(2, 3, Verb.REJOIN, 1, 40, 60)
    backlog = script.data.chunks[Stream.CONVERSION, 0, 0][3].copy()
    backlog["seq"] = 1
    script.data.chunks[Stream.BACKLOG, 1, 2].append(backlog)
    receipt = MachineReceipt(1, 2, 0, backlog=1, tick=5)
    script.soil(receipt=receipt, in_flight=-60, pending=40, particles=60)
    script.machine(2, 6, Verb.STEP, 2, 40, 0)
    script.soil(receipt=MachineReceipt(1, 2, 0, tick=6), pending=40)
    return script


def released() -> Script:
    """Its soil, without what was deposited before, is released in tick 5."""
    script = until_dropped()
    script.soil((ConversionKind.DEPOSIT, 0, 40), receipt=None)
    return script


@pytest.mark.parametrize("timeline", [until_dropped, rejoined, released])
def test_late_dropped_rejoined_and_released_machines_balance(
    timeline: Callable[[], Script],
) -> None:
    report = timeline().audit()
    assert report.passed, (report.findings, report.unchecked)
    assert report.max_imbalance_mm3 == 0
    assert report.audited == report.recorded


def test_late_machines_of_an_exchange_balance(tmp_path: Path) -> None:
    exchange = scripted_run(3)
    for tick in range(60):
        exchange.step(late=[n for n in (1, 2, 3) if (tick // n) % 4 == 3])
    exchange.keyframe()
    report = audit_bag(exchange.recording.write(tmp_path / "a.mcap"))
    assert report.passed, report.runs[0].findings
    (run,) = report.runs
    assert run.rows["DEPOSIT_REQUEST"] > 100


def test_machines_dropped_and_released_by_an_exchange_balance(tmp_path: Path) -> None:
    run = scripted_run(3)
    for _ in range(30):
        run.step()
    for machine_id in (2, 3):
        run.soil_endpoint.drop(machine_id)
        run.step()
    for _ in range(3):
        run.step()
    ledger = run.soil_endpoint.ledger
    assert ledger is not None
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
    assert ledger.absent > 0
    assert run.soil_endpoint.ledger is not None
    assert run.soil_endpoint.ledger.absent == 0


def test_released_soil_is_distinguished_from_deposited_soil() -> None:
    assert released().audit().moved_mm3["RELEASED"] == 40
    assert rejoined().audit().moved_mm3["RELEASED"] == 0


def test_1_mm3_released_too_much_is_found() -> None:
    script = until_dropped()
    script.soil((ConversionKind.DEPOSIT, 0, 40), receipt=None)
    script.data.chunks[Stream.CONVERSION, 0, 0][-1]["volume_mm3"] += 1
    failed = {finding.check for finding in script.audit().findings}
    assert {Check.TERRAIN, Check.LEDGER} <= failed


def test_backlog_that_is_not_a_copy_is_found() -> None:
    script = rejoined()
    script.data.chunks[Stream.BACKLOG, 1, 2][0]["volume_mm3"] += 1
    (finding,) = script.audit().findings
    assert finding.check is Check.BACKLOG


def test_machine_that_rejoins_with_other_soil_is_named() -> None:
    script = rejoined()
    script.machine(2, 3, Verb.REJOIN, 1, 40, 61)
    texts = [f.text for f in script.audit().findings if f.check is Check.ACCOUNTS]
    assert any("machine 1 rejoining before tick 5 has 1 mm3 too much" in text for text in texts)


def test_missing_header_that_was_accepted_late_is_found() -> None:
    script = until_dropped()
    del script.data.steps[1, 1][2]
    texts = [f.text for f in script.audit().findings if f.check is Check.COMPLETENESS]
    assert any(text == "machine 1's header of tick 2 is missing" for text in texts)


def test_answer_in_another_tick_than_its_request_is_found() -> None:
    script = until_dropped()
    late = script.data.soil[3].receipts[0]
    header = script.data.soil[2]
    modified = SoilHeader(1, 2, 1, header.conversions, header.map_updates, RowRange(), (late,))
    script.data.soil[2] = modified
    texts = [f.text for f in script.audit().findings if f.check is Check.DEPOSIT_REQUESTS]
    assert texts == [
        "the deposit request of machine 1's particle 1 of tick 2 was answered in tick 3"
    ]

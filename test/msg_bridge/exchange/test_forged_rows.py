"""Rows of another publisher, with numbers that fit, do not change a run."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.exchange_fakes import ExchangeDriver
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import MachineHeader, RowRange, Stream
from msg_bridge.contract.rows import SWEEP, empty_rows
from msg_bridge.exchange.row_digest import check_row_digest, row_digest
from msg_bridge.testing import LossyTransport


@pytest.mark.parametrize("seed", range(4))
def test_run_with_forged_rows_equals_the_run_without(seed: int) -> None:
    forged, clean = (
        ExchangeDriver(2, seed=seed, drop=0.05, delay=0.2, forge=forge) for forge in (0.1, 0.0)
    )
    for run in (forged, clean):
        run.ticks(60)
    assert isinstance(forged.transport, LossyTransport)
    assert forged.transport.forged > 50
    assert forged.soil.num_rejected > 0
    assert sum(machine.num_rejected for machine in forged.machines) > 0
    assert forged.soil.ledgers[:60] == clean.soil.ledgers[:60]
    assert forged.is_balanced()


def test_digest_depends_on_every_bit_and_on_the_order() -> None:
    rows = empty_rows(SWEEP, 3)
    rows["seq"] = 1, 2, 3
    digest = row_digest(rows)
    assert row_digest(rows[::-1]) != digest
    for name in SWEEP.names or ():
        changed = rows.copy()
        changed[name][1] = 77
        assert row_digest(changed) != digest


def test_rows_without_the_digest_of_their_header_are_rejected() -> None:
    with raises(ErrorCode.ROW_DIGEST):
        check_row_digest(empty_rows(SWEEP, 1), RowRange(1, 1), Stream.SWEEP)
    check_row_digest(empty_rows(SWEEP), RowRange(), Stream.SWEEP)


def test_machine_whose_tick_was_replaced_is_desynchronized_and_rejoins() -> None:
    run = ExchangeDriver(drop=0.0, duplicate=0.0, delay=0.0)
    run.ticks(10)
    machine = run.machines[0]
    forged = run.hold_next_tick(machine)[-1]  # of another publisher: without the machine's rows
    assert isinstance(forged, MachineHeader)
    none = {
        "sweeps": RowRange(forged.sweeps.first),
        "deposit_requests": RowRange(forged.deposit_requests.first),
    }
    assert forged.sweeps.count + forged.deposit_requests.count > 0
    run.soil.exchange.receive(replace(forged, **none))
    run.until(lambda: machine.exchange.is_desynchronized)
    machine.exchange.abandon_session()
    machine.entered = False
    machine.exchange.join(**machine.totals)
    run.until(lambda: 1 in run.soil.exchange.contending_requests)
    run.soil.exchange.drop(1)
    run.ticks(20)
    assert run.is_balanced()


def test_lossy_transport_does_not_desynchronize() -> None:
    run = ExchangeDriver(2, drop=0.3, duplicate=0.2, delay=0.5)
    for _ in range(200):
        run.ticks(1)
        assert not any(machine.exchange.is_desynchronized for machine in run.machines)

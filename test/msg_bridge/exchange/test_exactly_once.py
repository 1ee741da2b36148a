"""Every row is applied exactly once: any losses, late joiners, and peers that disappear."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.exchange_fakes import ExchangeDriver, FakeMachine

from msg_bridge.exchange.join_state import JoinState

NUM_MACHINES = 3
TICKS_BETWEEN_EVENTS = 6
NUM_ROWS = 1_000_000

EVENTS = ("leave", "join", "disappear", "return", "kill", "release")


class ChangingFleet(ExchangeDriver):
    """Machines that come and go while messages are lost.

    Attributes:
        away: machines that send and receive nothing, each with its soil.
    """

    def __init__(self, seed: int, **loss: float) -> None:
        super().__init__(NUM_MACHINES, expected=1, seed=seed, **loss)
        self.away: list[FakeMachine] = []
        self.num_sessions = 0

    def _request_missing_and_rejoin(self) -> None:
        """Do what nodes do by their timers: machines that were dropped rejoin."""
        for machine in self.machines:
            exchange = machine.exchange
            if machine.entered and exchange.join_state is JoinState.OUT:
                machine.entered = False
            if exchange.dropped and exchange.join_state is JoinState.OUT:
                exchange.join(**machine.totals)

    def round(self, *, leaving: FakeMachine | None = None) -> bool:
        """Do one round; machines that are away take no part."""
        self._request_missing_and_rejoin()
        return super().round(leaving=leaving)

    def happen(self, event: str, number: int) -> None:
        """Let something happen to a machine, if it can happen to it."""
        machine = self.machines[number % len(self.machines)] if self.machines else None
        if event == "return" and self.away:
            self.machines.append(self.away.pop())
            self.connect()
        elif machine is None:
            return
        elif event == "leave" and machine.exchange.joined:
            self.leave(machine)
        elif event == "join" and machine.exchange.join_state is JoinState.OUT:
            machine.exchange.join(**machine.totals)
        elif event in ("disappear", "kill"):
            self.machines.remove(machine)
            self.connect()
            if machine.exchange.machine_id in self.soil.exchange.joined:
                self.soil.exchange.drop(machine.exchange.machine_id)
            if event == "disappear":
                self.away.append(machine)
            else:  # another process takes its place, without soil
                self.num_sessions += 1000
                rng = np.random.default_rng(self.num_sessions)
                other = FakeMachine(rng, machine.exchange.machine_id, self.num_sessions)
                self.machines.append(other)
                self.connect()
                other.exchange.join()
        elif event == "release":
            self.soil.releasing = list(self.soil.exchange.releasable_machines)

    def some_ticks(self) -> None:
        """Do ticks; without a machine the soil does not wait."""
        goal = self.soil.exchange.tick + TICKS_BETWEEN_EVENTS
        for _ in range(20_000):
            if self.soil.exchange.tick >= goal:
                return
            self.round()
            if self.soil.exchange.tick >= 0 and not self.soil.exchange.joined:
                self.soil.step(wait=False)
        raise AssertionError(f"stuck at tick {self.soil.exchange.tick}")

    def until_joined(self, machine: FakeMachine) -> None:
        """Do ticks until a machine that has requested to join takes part."""
        while not machine.exchange.joined:
            assert not machine.exchange.rejection_reason
            self.some_ticks()


losses = st.fixed_dictionaries(
    {
        "drop": st.floats(0.0, 0.4),
        "duplicate": st.floats(0.0, 0.4),
        "delay": st.floats(0.0, 0.6),
    }
)
events = st.lists(st.tuples(st.sampled_from(EVENTS), st.integers(0, 10)), max_size=12)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), loss=losses, schedule=events)
def test_any_schedule_of_machines_and_losses_balances(
    seed: int, loss: dict[str, float], schedule: list[tuple[str, int]]
) -> None:
    fleet = ChangingFleet(seed, **loss)
    fleet.some_ticks()
    for event, number in schedule:
        fleet.happen(event, number)
        fleet.some_ticks()
    assert fleet.is_balanced()
    ledger = fleet.soil.ledgers[-1]
    assert ledger.terrain == fleet.soil.terrain
    # A machine that has applied each row once can rejoin with its soil: the soil checks the volume.
    for machine in [each for each in fleet.machines if each.exchange.joined]:
        fleet.leave(machine)
        machine.exchange.join(**machine.totals)
        fleet.until_joined(machine)
    assert fleet.is_balanced()


@pytest.mark.slow
@pytest.mark.independent
def test_million_rows_over_a_lossy_transport_are_exact() -> None:
    run = ExchangeDriver(2, drop=0.1, duplicate=0.1, delay=0.2)
    for machine in run.machines:
        machine.rows_per_tick = 1000
    counts: Counter[int] = Counter()
    while sum(counts.values()) < NUM_ROWS:
        run.ticks(20)
        for machine in run.machines:
            counts[machine.exchange.machine_id] += len(machine.applied)
            assert len(set(machine.applied)) == len(machine.applied)
            machine.applied.clear()
        run.soil.rows_seen.clear()
        run.soil.sweeps_seen.clear()
    assert run.is_balanced()
    assert run.transport.dropped > 0.05 * NUM_ROWS / 16  # type: ignore[attr-defined]

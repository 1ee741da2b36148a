"""Contacts between machines: reported with their force from the first touch to the last."""

from __future__ import annotations

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine

from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid

GRID = Grid(121, 121, 0.25)


def step(sim: MachineSim, ticks: int) -> None:
    for _ in range(ticks):
        output = sim.step()
        assert output.pending_mm3 == 0


def test_contact_is_reported_when_it_begins_and_when_it_ends() -> None:
    dumper, digger = load_shipped_machine("dumper"), load_shipped_machine("excavator")
    sim = MachineSim(
        [Placement(dumper, (-5.0, 0.0)), Placement(digger, (0.0, 0.0), 0.5 * np.pi)],
        GRID,
        np.zeros(GRID.shape),
    )
    step(sim, 50)
    assert sim.contacts.take_recent() == []
    sim.command(np.zeros(1), np.full(2, 0.8))
    for _ in range(300):
        step(sim, 1)
        if sim.contacts.take_recent():
            break
    (begun,) = sim.contacts.take_changes()
    assert begun.pair == (0, 1)
    assert not begun.is_over
    assert begun.start_time == pytest.approx(sim.tick * sim.params.tick_period, abs=0.011)
    assert -3.0 < begun.position[0] < -1.0
    step(sim, 50)
    sim.command(np.zeros(1), np.full(2, -0.8))
    step(sim, 200)
    (ended,) = sim.contacts.take_changes()
    assert sim.contacts.take_recent() == [ended], "it has ended since the last call"
    assert sim.contacts.take_recent() == []
    assert sim.contacts.num_contacts == 1
    sim.close()
    assert ended.is_over
    assert ended.start_time == begun.start_time
    assert ended.end_time > begun.end_time + 0.2
    # It pushes the excavator with the traction of both tracks at least, at most with all of 240 kN
    # and the impact.
    assert 2e4 < ended.max_force < 2e6

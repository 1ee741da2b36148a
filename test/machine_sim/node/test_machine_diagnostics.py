"""Overload in the diagnostics of a machine node, on a simulated clock."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from support.fake_diagnostics import FakeDiagnostics

from machine_sim.machine_contacts import MachineContact
from machine_sim.node.machine_diagnostics import MachineDiagnostics
from machine_sim.node.reported_motion import TickProgress
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.nodes.diagnostics import Level

TICK = 0.01


class Scene:
    """A machine node in a run of which only the progress matters, and what it reports."""

    def __init__(self, *, realtime: bool = True) -> None:
        self.now, fake = 100.0, FakeDiagnostics()
        self.values: dict[str, Any] = fake.values
        self.problems = fake.problems
        self.contacts: list[MachineContact] = []
        particles = SimpleNamespace(
            count=0,
            num_plate_tunnellings=0,
            num_ground_tunnellings=0,
            params=SimpleNamespace(nominal_volume=1000),
        )
        exchange = SimpleNamespace(join_state=JoinState.READY, joined=True)
        self.run: Any = SimpleNamespace(
            facts=SimpleNamespace(realtime=realtime, tick_period=TICK),
            progress=TickProgress(0, 0),
            tick=0,
            sim=SimpleNamespace(
                params=SimpleNamespace(max_releases_per_tick=60),
                particles=particles,
                pending_mm3=0,
                simulated_machines=[],
                contacts=SimpleNamespace(take_recent=lambda: self.contacts, num_contacts=0),
            ),
            endpoint=SimpleNamespace(exchange=exchange),
        )
        # The machines of this run are of no matter, so that two bins stand for them.
        diagnostics: Any = fake
        self.diagnostics = MachineDiagnostics(
            diagnostics, [], bins=("digger", "truck"), now=lambda: self.now
        )
        self.diagnostics.start_run(self.run)
        fake.update()
        self.fake = fake

    def seconds(self, count: int, *, ticks: int, skipped: int = 0, load: float = 0.5) -> Level:
        """Let seconds pass with ticks made and skipped in each; return the last level."""
        for _ in range(count):
            self.now += 1.0
            for _ in range(ticks):
                self.diagnostics.record_tick(load * TICK)
            made, passed = self.run.progress
            self.run.progress = TickProgress(made + ticks, passed + ticks + skipped)
            self.fake.update()
        return self.problems.get("overload", ("", Level.OK))[1]


def test_machine_with_spare_time_is_no_problem() -> None:
    scene = Scene()
    assert scene.seconds(5, ticks=100, load=0.9) is Level.OK
    shown = {key: float(scene.values[key]) for key in ("real_time_factor", "tick_load_mean")}
    assert shown == {"real_time_factor": pytest.approx(1.0), "tick_load_mean": pytest.approx(0.9)}


@pytest.mark.parametrize(("load", "level"), [(1.2, Level.WARN), (3.0, Level.ERROR)])
def test_ticks_that_take_longer_than_their_period_are_reported(load: float, level: Level) -> None:
    scene = Scene()
    assert scene.seconds(1, ticks=round(100 / load), load=load) is Level.OK
    assert scene.seconds(3, ticks=round(100 / load), load=load) is level
    assert f"a tick takes {load:.2f} of its period" in scene.problems["overload"][0]
    assert float(scene.values["real_time_factor"]) == pytest.approx(1 / load, abs=0.01)
    assert scene.seconds(1, ticks=100) is Level.OK


@pytest.mark.parametrize("count", [0, 100])
def test_fewer_particles_are_advised_only_if_there_are_any(count: int) -> None:
    scene = Scene()
    scene.run.sim.particles.count = count
    scene.seconds(4, ticks=50, load=2.0)
    assert ("fewer particles" in scene.problems["overload"][0]) == bool(count)


@pytest.mark.parametrize(("skipped", "level"), [(2, Level.OK), (10, Level.WARN), (60, Level.ERROR)])
def test_skipped_ticks_are_counted_and_reported(skipped: int, level: Level) -> None:
    scene = Scene()
    assert scene.seconds(4, ticks=100 - skipped, skipped=skipped) is level
    assert scene.values["skipped_ticks"] == 4 * skipped
    if level is not Level.OK:
        assert f"makes {100 - skipped}% of the ticks" in scene.problems["overload"][0]


def test_wait_for_the_soil_is_no_overload_of_the_machine() -> None:
    scene = Scene()
    scene.seconds(2, ticks=100)
    assert scene.seconds(5, ticks=0) is Level.OK
    assert float(scene.values["real_time_factor"]) == 0.0


def test_slow_lockstep_is_no_overload() -> None:
    assert Scene(realtime=False).seconds(5, ticks=10, load=10.0) is Level.OK


def test_machines_that_touch_are_reported_with_their_force() -> None:
    scene = Scene()
    contact = MachineContact((0, 1), 1.0, 1.2, 853e3, (1.0, 2.0, 3.0))
    scene.contacts = [contact]
    scene.fake.update()
    text, level = scene.problems["contacts"]
    assert "digger and truck" in text
    assert "853 kN" in text
    assert level is Level.WARN
    scene.contacts = [replace(contact, is_over=True)]
    scene.fake.update()
    assert "digger and truck touched" in scene.problems["contacts"][0]
    scene.contacts = []
    scene.fake.update()
    assert "contacts" not in scene.problems


@pytest.mark.parametrize(("pending", "is_reported"), [(6_000_000, False), (6_100_000, True)])
def test_soil_that_becomes_particles_too_slowly_is_reported(
    pending: int, is_reported: bool
) -> None:
    """Of 60 particles of 1000 mm^3 in each of 100 ticks, 6,000,000 mm^3 a second."""
    scene = Scene()
    scene.run.sim.pending_mm3 = pending
    scene.seconds(1, ticks=100)
    reports = [text for text, _ in scene.problems.values()]
    expected = "0.006 m3 of excavated soil wait to become particles, of which 0.006 m3 a second"
    assert any(text.startswith(expected) for text in reports) == is_reported

"""Overload in the diagnostics of the soil node, on a simulated clock."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from support.fake_diagnostics import FakeDiagnostics
from support.soil_scenes import bucket_sweep, flat_soil, make_deposit_requests

from msg_bridge.contract.rows import MAP_UPDATE, empty_rows
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.nodes.diagnostics import Level
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_diagnostics import SoilDiagnostics
from soil_sim.node.soil_run import SoilRun
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import flat

TICK = 0.01
AT_REST = bucket_sweep((0, 0, 1), (0, 0, 1))


class Scene:
    """A soil run with one machine, which may take several periods for a tick; its diagnostics."""

    def __init__(self, *, joined: bool = True, **params: Any) -> None:
        self.now, self.log = 100.0, []
        node_params = SoilNodeParams(tick_period=TICK, **params)
        site = Site(flat(flat_soil().grid))
        self.run = SoilRun(site, SoilParams(), node_params, run_id=7)
        self.machine = MachineExchange(1, run_id=7)
        logger = SimpleNamespace(warning=self.log.append, info=self.log.append)
        node: Any = SimpleNamespace(get_logger=lambda: logger, count_publishers=lambda topic: 1)
        self.diagnostics: Any = FakeDiagnostics()
        self.soil_diagnostics = SoilDiagnostics(
            node, self.diagnostics, self.run, node_params, now=lambda: self.now
        )
        self.soil_diagnostics.start_run()
        if joined:
            self.machine.join()
            self.exchange()

    def exchange(self) -> None:
        """Deliver all messages and compute the tick that is due and complete, if any."""
        for message in self.machine.drain_outbox():
            self.run.endpoint.receive(message)
        self.run.advance(self.now)
        for message in self.run.endpoint.drain_outbox():
            self.machine.receive(message)
        if self.machine.poll() is not None:
            self.machine.acknowledge_answer()

    def seconds(self, duration: float, *, periods: int = 1) -> list[Level]:
        """Let time pass with a machine that is ready every few periods; return all levels."""
        levels = []
        for count in range(1, round(duration / TICK) + 1):
            self.now += TICK
            if self.run.params.sync == "realtime":
                self.run.on_timer(self.now)
            if count % periods == 0 and self.machine.join_state is JoinState.READY:
                nothing = make_deposit_requests([], [], 0)
                self.machine.send(AT_REST.copy(), nothing, pending_mm3=0, particles_mm3=0)
            self.exchange()
            if count % round(1.0 / TICK) == 0:
                self.diagnostics.update()
                levels.append(self.level)
        return levels

    @property
    def level(self) -> Level:
        return self.diagnostics.problems.get("overload", ("", Level.OK))[1]


def test_columns_dug_down_to_the_floor_are_reported_until_they_are_filled() -> None:
    scene = Scene()
    scene.diagnostics.update()
    assert scene.diagnostics.values["columns_at_floor"] == 0
    columns = scene.run.endpoint.soil.columns
    height = columns.height[4, 5]
    changed = empty_rows(MAP_UPDATE, 2)
    changed["row"], changed["col"] = (4, 3), 5
    columns.height[4, 5] = columns.floor
    scene.soil_diagnostics.record_tick(0.0, changed)
    scene.diagnostics.update()
    assert scene.diagnostics.values["columns_at_floor"] == 1
    assert scene.diagnostics.problems["floor"][1] is Level.WARN
    scene.soil_diagnostics.start_run()  # counts those of a run that is continued
    scene.diagnostics.update()
    assert scene.diagnostics.values["columns_at_floor"] == 1
    columns.height[4, 5] = height
    scene.soil_diagnostics.record_tick(0.0, changed)
    scene.diagnostics.update()
    assert "floor" not in scene.diagnostics.problems


def test_real_time_is_no_problem() -> None:
    scene = Scene()
    assert set(scene.seconds(6.0)) == {Level.OK}
    assert float(scene.diagnostics.values["real_time_factor"]) == pytest.approx(1.0, abs=0.02)
    assert scene.diagnostics.values["late_ticks_by_machine"] == "none"


def test_slow_machine_is_named_until_the_clock_is_in_real_time_again() -> None:
    scene = Scene()
    scene.seconds(2.0)
    assert scene.seconds(5.0, periods=3)[-1] is Level.ERROR
    text, _ = scene.diagnostics.problems["overload"]
    assert "ticks wait for machine 1" in text
    assert "particles" not in text, "there are none, so that fewer would not help"
    assert float(scene.diagnostics.values["real_time_factor"]) == pytest.approx(1 / 3, abs=0.05)
    assert scene.diagnostics.values["new_late_ticks"] == pytest.approx(33, abs=2)
    assert 1 <= len(scene.log) <= 2  # as WARN, then as ERROR
    assert scene.seconds(3.0)[-1] is Level.OK
    assert "in real time again" in scene.log[-1]


@pytest.mark.parametrize("sync", ["realtime", "lockstep"])
def test_pause_is_no_overload(sync: str) -> None:
    scene = Scene(sync=sync)
    scene.seconds(2.0)
    scene.run.pause(True)
    assert set(scene.seconds(5.0)) == {Level.OK}
    scene.run.pause(False)
    assert set(scene.seconds(5.0)) == {Level.OK}


def test_slow_lockstep_is_no_overload() -> None:
    assert set(Scene(sync="lockstep").seconds(5.0, periods=10)) == {Level.OK}


def test_wait_for_the_first_machine_is_no_overload() -> None:
    assert set(Scene(joined=False).seconds(5.0)) == {Level.OK}


def test_clock_that_continues_without_the_machine_is_in_real_time() -> None:
    scene = Scene(overload="skip_ticks")
    assert set(scene.seconds(6.0, periods=4)) == {Level.OK}
    assert float(scene.diagnostics.values["real_time_factor"]) == pytest.approx(1.0, abs=0.05)
    assert scene.diagnostics.values["late_ticks"] > 100

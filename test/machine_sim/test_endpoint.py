"""Machine endpoint with a soil that only keeps volume accounts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from support.machine_scenes import GRID, machine_on_level_ground
from support.wire import raises

from machine_sim.endpoint import MachineEndpoint
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe, MachineHeader, RowChunk, Stream, Verb
from msg_bridge.contract.rows import CONVERSION, FORCE, MAP_UPDATE, ConversionKind, empty_rows
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.welcome import Welcome


class FakeSoil:
    """Soil exchange on level terrain, with answers given by the test."""

    def __init__(self, side: MachineEndpoint) -> None:
        self.side = side
        self.height = 0.0
        self.exchange = SoilExchange(Welcome(GRID, lambda: np.full(GRID.shape, self.height)))
        self.messages: list[object] = []

    @property
    def header(self) -> MachineHeader:
        """Header of the machine's latest tick."""
        (header,) = (each for each in self.messages if isinstance(each, MachineHeader))
        return header

    def to_soil(self) -> None:
        self.messages = self.side.drain_outbox()
        for message in self.messages:
            self.exchange.receive(message)

    def answer(self, parcels: tuple[int, ...] = (), raised: float | None = None) -> None:
        """Answer a tick: parcels [mm^3] at the tool, one column raised to a height [m]."""
        self.to_soil()
        tick = self.exchange.poll()
        assert tick is not None
        rows = empty_rows(CONVERSION, len(parcels))
        rows["kind"], rows["machine_id"], rows["volume_mm3"] = ConversionKind.EXCAVATE, 1, parcels
        rows["x"], rows["y"], rows["z"] = self.side.sim.tool_coupling.key_points_at(0)[0]
        map_updates = empty_rows(MAP_UPDATE, 0 if raised is None else 1)
        map_updates["revision"], map_updates["z"] = tick.tick + 1, raised or 0.0
        revision = tick.tick + 1
        self.exchange.answer(
            rows,
            empty_rows(FORCE),
            map_updates,
            revision=revision,
            terrain_mm3=10**15 - sum(parcels),
        )
        for message in self.exchange.drain_outbox():
            self.side.receive(message)


@pytest.fixture
def side() -> Iterator[MachineEndpoint]:
    sim = machine_on_level_ground()
    yield MachineEndpoint(sim, MachineExchange(1))
    sim.close()


@pytest.fixture
def soil(side: MachineEndpoint) -> FakeSoil:
    """Return a soil that the machine has joined."""
    soil = FakeSoil(side)
    side.join()
    soil.answer()
    return soil


def test_machine_is_ready_once_it_has_joined_and_received_the_terrain(
    side: MachineEndpoint,
) -> None:
    soil = FakeSoil(side)
    side.join()
    assert not side.is_ready
    soil.height = 0.25
    soil.answer()
    assert side.is_ready
    assert side.tick == 0
    assert (side.sim.ground.elevation == 0.25).all()


def test_tick_sends_header_and_sweep(side: MachineEndpoint, soil: FakeSoil) -> None:
    side.step()
    assert (side.tick, side.exchange.tick) == (1, 0)
    soil.to_soil()
    header = soil.header
    assert (header.tick, header.verb, header.previous_tick) == (1, Verb.STEP, 0)
    (sweep,) = (each for each in soil.messages if isinstance(each, RowChunk))
    assert (sweep.stream, sweep.rows.size) == (Stream.SWEEP, header.sweeps.count)


def test_tick_after_the_next_waits_for_the_answer(side: MachineEndpoint, soil: FakeSoil) -> None:
    side.step()
    assert side.is_ready
    side.step()
    assert not side.is_ready
    assert side.poll() is None
    with raises(ErrorCode.JOIN_STATE):
        side.step()


def test_answer_is_applied_after_the_next_tick(side: MachineEndpoint, soil: FakeSoil) -> None:
    side.step()
    soil.answer(parcels=(700,))
    assert side.poll() is None
    side.step()
    assert side.poll() is not None
    assert side.sim.pending_mm3 == 700


def test_answer_adds_pending_soil_and_updates_the_ground(
    side: MachineEndpoint, soil: FakeSoil
) -> None:
    side.step()
    soil.answer(parcels=(5_000_000, 700), raised=0.125)
    side.step()
    answer = side.poll()
    assert answer is not None
    assert answer.conversions.size == 2
    assert (side.is_ready, side.tick, side.exchange.tick) == (True, 2, 1)
    assert side.sim.pending_mm3 == 5_000_700
    assert side.sim.ground.elevation[0, 0] == 0.125
    assert side.poll() is None  # it is applied once


def test_rejected_answer_changes_nothing_and_is_requested_again(
    side: MachineEndpoint, soil: FakeSoil, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reject(*_: object, **__: object) -> None:
        raise ExchangeError("broken", ErrorCode.VALUE)

    side.step()
    soil.answer(parcels=(700,), raised=0.125)
    side.step()
    before = side.sim.state_hash()
    with monkeypatch.context() as patch:
        patch.setattr(side.sim, "check_answer", reject)
        with raises(ErrorCode.VALUE):
            side.poll()
    assert side.sim.state_hash() == before
    assert side.poll() is None
    side.exchange.request_missing()
    for _ in range(2):  # the header first, then the rows that it counts
        side.exchange.request_missing()
        soil.to_soil()
        for message in soil.exchange.drain_outbox():
            side.receive(message)
    assert side.poll() is not None
    assert side.sim.pending_mm3 == 700


def test_failure_while_applying_an_answer_does_not_acknowledge_it(
    side: MachineEndpoint, soil: FakeSoil, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise MemoryError

    side.step()
    soil.answer(parcels=(700,))
    side.step()
    with monkeypatch.context() as patch:
        patch.setattr(side.sim, "apply", fail)
        with pytest.raises(MemoryError):
            side.poll()
    assert side.exchange.waiting
    assert side.poll() is not None


def test_terrain_of_another_grid_is_rejected(side: MachineEndpoint) -> None:
    with raises(ErrorCode.GRID):
        side.receive(Keyframe(1, 1, Grid(5, 5, 0.2), np.ones((5, 5))))


def test_terrain_with_a_height_that_is_not_finite_is_rejected(side: MachineEndpoint) -> None:
    with raises(ErrorCode.VALUE):
        side.receive(Keyframe(1, 1, GRID, np.full(GRID.shape, np.nan)))


def test_pending_soil_moves_with_the_tool(side: MachineEndpoint, soil: FakeSoil) -> None:
    side.sim.command(np.array([0.5, 0.0, 0.0, 0.0]), np.zeros(2))
    for _ in range(30):
        side.step()
        soil.answer()
        side.poll()
    side.step()
    cut_at = side.sim.machine.tool.pose
    lip = side.sim.tool_coupling.key_points_at(0)[0]
    soil.answer(parcels=(5_000_000,))  # at the lip
    side.poll()
    side.step()
    _, place = side.sim.machine.tool.pose
    assert np.linalg.norm(place - cut_at[1]) > 0.01
    side.poll()
    (point,) = side.sim.tool_coupling.pending.points
    np.testing.assert_allclose(point, cut_at[0].T @ (lip - cut_at[1]), atol=1e-6)


def test_totals_in_the_header_include_the_answer(side: MachineEndpoint, soil: FakeSoil) -> None:
    side.step()
    soil.answer(parcels=(5_000_000,))
    side.step()
    side.poll()
    soil.answer()
    side.step()
    soil.to_soil()
    header = soil.header
    assert header.pending_mm3 + header.particles_mm3 == 5_000_000
    assert header.conversions_received == 1


def test_leaving_machine_sends_leave_and_is_not_ready(
    side: MachineEndpoint, soil: FakeSoil
) -> None:
    side.step(leave=True)
    soil.answer()
    assert soil.header.verb is Verb.LEAVE
    assert side.poll() is not None
    assert not side.is_ready
    assert not side.exchange.joined


def test_rejoining_machine_keeps_its_soil_and_receives_the_backlog(
    side: MachineEndpoint, soil: FakeSoil
) -> None:
    side.step()
    soil.answer(parcels=(3_000_000,))
    side.step()
    side.poll()
    soil.answer()
    side.step(leave=True)
    soil.answer(parcels=(40,))  # moved in its last tick, which it does not take
    side.poll()
    assert side.sim.pending_mm3 + side.sim.particles.total_volume_mm3 == 3_000_000
    side.join()
    soil.height = 0.5
    soil.to_soil()
    assert soil.header.verb is Verb.REJOIN
    soil.answer()
    assert side.is_ready
    assert side.sim.pending_mm3 + side.sim.particles.total_volume_mm3 == 3_000_040
    assert (side.sim.ground.elevation == 0.5).all()


def test_keyframe_of_another_run_is_ignored(side: MachineEndpoint, soil: FakeSoil) -> None:
    side.receive(Keyframe(9, 1, GRID, np.ones(GRID.shape)))
    assert (side.sim.ground.elevation == 0.0).all()


def test_discarded_soil_is_gone_and_the_next_join_is_one_without_soil(
    side: MachineEndpoint, soil: FakeSoil
) -> None:
    side.step()
    soil.answer(parcels=(3_000_000, 40))
    side.step()
    side.poll()
    soil.answer()
    side.step()
    with raises(ErrorCode.JOIN_STATE):
        side.discard_soil()
    side.exchange.abandon_session()
    assert side.discard_soil() == 3_000_040
    assert (side.sim.pending_mm3, side.sim.particles.count) == (0, 0)
    side.join()
    soil.to_soil()
    assert soil.header.verb is Verb.JOIN

"""A machine behind its end of the exchange, with a soil that only keeps books."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from support.machine_scenes import GRID, machine_on_level_ground

from machine_sim.endpoint import MachineEndpoint
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe, MachineHeader, RowChunk, Stream, Verb
from msg_bridge.contract.rows import CONVERSION, FORCE, MAP_UPDATE, ConversionKind, empty_rows
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.soil_exchange import SoilExchange


class Books:
    """A soil's end of the exchange at height `height`, that answers what the test says."""

    def __init__(self, side: MachineEndpoint) -> None:
        self.side = side
        self.height = 0.0
        self.exchange = SoilExchange(GRID, lambda: np.full(GRID.shape, self.height))
        self.said: list[object] = []

    @property
    def header(self) -> MachineHeader:
        """What the machine said of its latest tick."""
        (header,) = (each for each in self.said if isinstance(each, MachineHeader))
        return header

    def to_soil(self) -> None:
        self.said = self.side.drain_outbox()
        for message in self.said:
            self.exchange.receive(message)

    def answer(self, parcels: tuple[int, ...] = (), raised: float | None = None) -> None:
        """Do a tick: parcels [mm^3] for the machine, and one column raised to a height [m]."""
        self.to_soil()
        tick = self.exchange.poll()
        assert tick is not None
        rows = empty_rows(CONVERSION, len(parcels))
        rows["kind"], rows["machine_id"], rows["volume_mm3"] = ConversionKind.EXCAVATE, 1, parcels
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
def books(side: MachineEndpoint) -> Books:
    """A soil that the machine has joined."""
    made = Books(side)
    side.join()
    made.answer()
    return made


def test_a_machine_is_ready_once_it_has_been_welcomed_with_the_terrain(
    side: MachineEndpoint,
) -> None:
    soil = Books(side)
    side.join()
    assert not side.is_ready
    soil.height = 0.25
    soil.answer()
    assert side.is_ready
    assert side.tick == 0
    assert (side.sim.ground.elevation == 0.25).all()


def test_a_tick_sends_header_and_sweep(side: MachineEndpoint, books: Books) -> None:
    side.step()
    assert (side.tick, side.exchange.tick) == (1, 0)
    books.to_soil()
    header = books.header
    assert (header.tick, header.verb, header.previous_tick) == (1, Verb.STEP, 0)
    (sweep,) = (each for each in books.said if isinstance(each, RowChunk))
    assert (sweep.stream, sweep.rows.size) == (Stream.SWEEP, header.sweeps.count)


def test_the_tick_after_the_next_waits_for_the_answer(side: MachineEndpoint, books: Books) -> None:
    side.step()
    assert side.is_ready
    side.step()
    assert not side.is_ready
    assert side.poll() is None
    with pytest.raises(ExchangeError, match="waiting"):
        side.step()


def test_an_answer_is_taken_after_the_next_tick_and_not_sooner(
    side: MachineEndpoint, books: Books
) -> None:
    side.step()
    books.answer(parcels=(700,))
    assert side.poll() is None
    side.step()
    assert side.poll() is not None
    assert side.sim.pending_mm3 == 700


def test_the_answer_becomes_pending_soil_and_new_ground(
    side: MachineEndpoint, books: Books
) -> None:
    side.step()
    books.answer(parcels=(5_000_000, 700), raised=0.125)
    side.step()
    answer = side.poll()
    assert answer is not None
    assert answer.conversions.size == 2
    assert (side.is_ready, side.tick, side.exchange.tick) == (True, 2, 1)
    assert side.sim.pending_mm3 == 5_000_700
    assert side.sim.ground.elevation[0, 0] == 0.125
    assert side.poll() is None  # it is applied once


def test_what_was_cut_moves_on_with_the_tool_until_it_is_a_particle(
    side: MachineEndpoint, books: Books
) -> None:
    side.sim.command(np.array([0.5, 0.0, 0.0, 0.0]), np.zeros(2))
    for _ in range(30):
        side.step()
        books.answer()
        side.poll()
    side.step()
    cut_at = side.sim.machine.tool.pose
    books.answer(parcels=(5_000_000,))  # at the map's origin
    side.poll()
    side.step()
    _, place = side.sim.machine.tool.pose
    assert np.linalg.norm(place - cut_at[1]) > 0.01
    side.poll()
    (point,) = side.sim.tool_coupling.pending.points
    np.testing.assert_allclose(point, cut_at[0].T @ -cut_at[1], atol=1e-12)


def test_totals_in_the_header_are_those_after_the_answer(
    side: MachineEndpoint, books: Books
) -> None:
    side.step()
    books.answer(parcels=(5_000_000,))
    side.step()
    side.poll()
    books.answer()
    side.step()
    books.to_soil()
    header = books.header
    assert header.pending_mm3 + header.particles_mm3 == 5_000_000
    assert header.conversions_received == 1


def test_who_leaves_is_not_ready_again_and_says_so(side: MachineEndpoint, books: Books) -> None:
    side.step(leave=True)
    books.answer()
    assert books.header.verb is Verb.LEAVE
    assert side.poll() is not None
    assert not side.is_ready
    assert not side.exchange.joined


def test_who_comes_back_brings_its_soil_and_is_given_what_it_is_owed(
    side: MachineEndpoint, books: Books
) -> None:
    side.step()
    books.answer(parcels=(3_000_000,))
    side.step()
    side.poll()
    books.answer()
    side.step(leave=True)
    books.answer(parcels=(40,))  # moved in its last tick, which it does not take
    side.poll()
    assert side.sim.pending_mm3 + side.sim.particles.total_volume_mm3 == 3_000_000
    side.join()
    books.height = 0.5
    books.to_soil()
    assert books.header.verb is Verb.REJOIN
    books.answer()
    assert side.is_ready
    assert side.sim.pending_mm3 + side.sim.particles.total_volume_mm3 == 3_000_040
    assert (side.sim.ground.elevation == 0.5).all()


def test_a_keyframe_of_another_run_is_no_terrain_of_this_one(
    side: MachineEndpoint, books: Books
) -> None:
    side.receive(Keyframe(9, 1, GRID, np.ones(GRID.shape)))
    assert (side.sim.ground.elevation == 0.0).all()

"""The soil behind its end of the exchange, with a machine that is only its messages."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.soil_scenes import bucket_sweep, flat_soil, landings

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe, Message, SoilHeader
from msg_bridge.contract.rows import MAX_ROW_VOLUME, Rows
from msg_bridge.exchange.machine_side import MachineExchange
from soil_sim.params import SoilParams
from soil_sim.side import SoilSide, SoilTick
from soil_sim.soil import Soil

NOTHING = landings([], [], 0)
DOWN = [(0.3, 0.05), (0.2, -0.05), (0.1, -0.15), (0.0, -0.2), (-0.1, -0.2)]  # lip (x, z) [m]


class Digger:
    """A machine's end of the exchange that keeps what it is given as one number."""

    def __init__(self, side: SoilSide, source: int = 1) -> None:
        self.side = side
        self.exchange = MachineExchange(source)
        self.held = 0
        self.exchange.join()
        self.carry()

    def carry(self) -> list[Message]:
        """Both boxes, once each; returns what the soil said."""
        for message in self.exchange.take_outbox():
            self.side.receive(message)
        said = self.side.take_outbox()
        for message in said:
            self.exchange.receive(message)
        return said

    def send(self, sweeps: Rows, landed: Rows = NOTHING, *, leave: bool = False) -> None:
        self.exchange.send(sweeps, landed, pending_mm3=self.held, particles_mm3=0, leave=leave)
        for message in self.exchange.take_outbox():
            self.side.receive(message)

    def take(self) -> None:
        """Takes the answer that is due: to the tick before the last sent."""
        self.carry()
        answer = self.exchange.poll()
        if answer is not None:
            self.held += int(answer.conversions["volume_mm3"].astype(np.int64).sum())

    def dig(self) -> SoilTick:
        """Pushes a bucket into the ground and waits a tick; returns the last tick."""
        done = None
        for (x0, z0), (x1, z1) in pairwise([*DOWN, DOWN[-1]]):
            self.send(bucket_sweep((x0, 0.0, z0), (x1, 0.0, z1)))
            done = self.side.advance()
            self.take()
        assert done is not None
        return done


@pytest.fixture
def side() -> SoilSide:
    return SoilSide(flat_soil())


def welcomed(side: SoilSide) -> Digger:
    digger = Digger(side)
    assert side.advance() is not None
    digger.carry()
    assert digger.exchange.joined
    return digger


def test_nothing_happens_before_the_expected_machines_have_joined() -> None:
    side = SoilSide(flat_soil(), expected=(1, 2))
    assert side.tick == -1
    Digger(side, 1)
    assert side.advance() is None
    Digger(side, 2)
    done = side.advance()
    assert done is not None
    assert (done.ledger.tick, side.tick) == (0, 0)


def test_the_welcome_moves_nothing_and_shows_the_terrain(side: SoilSide) -> None:
    digger = Digger(side)
    done = side.advance()
    assert done is not None
    assert done.step.conversions.size == done.step.changed.size == 0
    assert done.ledger.terrain == side.soil.total_mm3 == done.ledger.start
    said = digger.carry()
    assert [type(message) for message in said] == [SoilHeader, Keyframe]
    assert (said[1].elevation == side.soil.columns.height).all()
    shown = (said[1].volume_mm3, said[1].soil, said[1].moisture)
    assert all(map(np.array_equal, shown, side.soil.layers))


def test_what_a_bucket_takes_is_told_in_conversions_and_balances(side: SoilSide) -> None:
    digger = welcomed(side)
    before = side.soil.total_mm3
    done = digger.dig()
    assert digger.held == before - side.soil.total_mm3 > 0
    assert done.ledger.imbalance == 0
    assert side.soil.verify()


def test_a_tick_waits_for_every_machine_unless_told_not_to(side: SoilSide) -> None:
    digger = welcomed(side)
    assert side.advance() is None
    done = side.advance(wait=False)
    assert done is not None
    assert side.tick == 1
    digger.carry()
    digger.send(bucket_sweep((0, 0, 1), (0, 0, 1)))
    assert side.advance() is not None


def test_what_an_absent_machine_held_becomes_terrain_where_it_last_swept(side: SoilSide) -> None:
    digger = welcomed(side)
    digger.dig()
    x, z = DOWN[-1]
    digger.send(bucket_sweep((x, 0.0, z), (x, 0.0, 1.0)), leave=True)
    left = side.advance()
    assert left is not None
    held = left.ledger.absent
    assert held >= digger.held > 0
    heights = side.soil.columns.height.copy()
    assert side.release_absent() == (1,)
    done = side.advance(wait=False)
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    assert done.ledger.terrain == left.ledger.terrain + held
    raised = np.argwhere(side.soil.columns.height > heights + 1e-6)
    # The left end of the lip, where the first pair of its key points was, within what slips.
    grid = side.soil.grid
    place = np.array([grid.row(x), grid.col(0.6)])
    assert np.hypot(*(raised - place).T).min() < 2.5
    assert side.soil.verify()


def test_what_is_released_is_of_the_kind_and_as_moist_as_what_was_dug() -> None:
    grid = Grid(61, 61, 0.2)
    ids = np.full(grid.shape, 1, dtype=np.uint8)
    params = SoilParams(soil="loam", other_soils=("wet clay",))
    soil = Soil(grid, np.zeros(grid.shape), params, soil=ids, moisture=np.full(grid.shape, 63))
    side = SoilSide(soil)
    digger = welcomed(side)
    digger.dig()
    x, z = DOWN[-1]
    digger.send(bucket_sweep((x, 0.0, z), (x, 0.0, 1.0)), leave=True)
    side.advance()
    loose = soil.columns.loose.copy()
    side.release_absent()
    done = side.advance(wait=False)
    assert done is not None
    rows = done.step.conversions
    assert set(zip(rows["soil"].tolist(), rows["moisture"].tolist(), strict=True)) == {(1, 63)}
    grown = soil.columns.loose > loose
    assert grown.any()
    assert set(soil.columns.loose_moisture[grown].tolist()) == {63}
    assert set(soil.columns.loose_soil[grown].tolist()) == {1}


def test_nothing_is_released_where_nobody_has_left_anything(side: SoilSide) -> None:
    digger = welcomed(side)
    digger.dig()
    assert side.release_absent() == ()


def test_a_machine_that_asks_to_come_back_before_the_release_keeps_what_it_holds(
    side: SoilSide,
) -> None:
    digger = welcomed(side)
    digger.dig()
    digger.send(bucket_sweep((0, 0, 1), (0, 0, 1)), leave=True)
    side.advance()
    digger.carry()
    digger.exchange.poll()
    assert side.release_absent() == (1,)
    digger.exchange.join(pending_mm3=digger.held)
    digger.carry()
    assert side.release_absent() == ()
    done = side.advance()
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    assert done.ledger.pending == digger.held > 0
    digger.carry()
    digger.send(bucket_sweep((0, 0, 1), (0, 0, 1)))
    assert side.advance() is not None


def test_a_volume_beyond_what_one_row_carries_is_released_whole(side: SoilSide) -> None:
    volume = 2 * MAX_ROW_VOLUME + 5
    side.exchange.release = lambda source: volume  # type: ignore[method-assign]
    rows = side._released(3)
    assert rows["volume_mm3"].tolist() == [MAX_ROW_VOLUME, MAX_ROW_VOLUME, 5]
    assert rows["particle_id"].tolist() == [0, 1, 2]
    assert set(rows["source"].tolist()) == {3}

"""Soil endpoint, with a machine that consists of its messages."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.soil_scenes import bucket_sweep, flat_soil, make_deposit_requests

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe, Message, SoilHeader
from msg_bridge.contract.rows import MAX_ROW_VOLUME, Rows
from msg_bridge.exchange import ended_accounts
from msg_bridge.exchange.machine_exchange import MachineExchange
from soil_sim.endpoint import SoilEndpoint, SoilTickResult, split_into_deposit_requests
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

NOTHING = make_deposit_requests([], [], 0)
DOWN = [(0.3, 0.05), (0.2, -0.05), (0.1, -0.15), (0.0, -0.2), (-0.1, -0.2)]  # lip (x, z) [m]


class Digger:
    """Machine exchange that accounts its soil as one number."""

    def __init__(self, endpoint: SoilEndpoint, machine_id: int = 1, session_id: int = 0) -> None:
        self.endpoint = endpoint
        self.exchange = MachineExchange(machine_id, session_id=session_id)
        self.soil_mm3 = 0
        self.exchange.join()
        self.deliver()

    def deliver(self) -> list[Message]:
        """Deliver all messages in both directions; return those of the soil."""
        for message in self.exchange.drain_outbox():
            self.endpoint.receive(message)
        sent = self.endpoint.drain_outbox()
        for message in sent:
            self.exchange.receive(message)
        return sent

    def send(self, sweeps: Rows, deposit_requests: Rows = NOTHING, *, leave: bool = False) -> None:
        self.exchange.send(
            sweeps, deposit_requests, pending_mm3=self.soil_mm3, particles_mm3=0, leave=leave
        )
        for message in self.exchange.drain_outbox():
            self.endpoint.receive(message)

    def take(self) -> None:
        """Apply the answer that is due: to the tick before the last one sent."""
        self.deliver()
        answer = self.exchange.poll()
        if answer is not None:
            self.soil_mm3 += int(answer.conversions["volume_mm3"].astype(np.int64).sum())
            self.exchange.acknowledge_answer()

    def dig(self, x: float = 0.0) -> SoilTickResult:
        """Push a bucket into the ground at x and wait a tick; return the last tick."""
        done = None
        for (x0, z0), (x1, z1) in pairwise([*DOWN, DOWN[-1]]):
            self.send(bucket_sweep((x + x0, 0.0, z0), (x + x1, 0.0, z1)))
            done = self.endpoint.advance()
            self.take()
        assert done is not None
        return done

    def leave(self, x: float) -> None:
        """Leave with a last tick in the air at x."""
        self.send(bucket_sweep((x, 0.0, 1.0), (x, 0.0, 1.0)), leave=True)
        assert self.endpoint.advance() is not None
        self.take()
        assert not self.exchange.joined

    def rejoin(self) -> None:
        """Rejoin with the soil, and apply the backlog."""
        self.exchange.join(pending_mm3=self.soil_mm3)
        self.deliver()
        assert self.endpoint.advance() is not None
        self.deliver()
        assert self.exchange.joined
        self.soil_mm3 += int(self.exchange.backlog["volume_mm3"].sum(dtype=np.int64))


def released_soil(endpoint: SoilEndpoint, digger: Digger | None = None) -> set[tuple[int, float]]:
    """Do the tick of a release; return kind and x of the released soil, rounded to 1.5 m.

    Args:
        endpoint: the soil.
        digger: sends its next tick, in the air.
    """
    if digger is not None:
        digger.send(bucket_sweep((3.0, 0, 1), (3.0, 0, 1)))
    done = endpoint.advance(wait=False)
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    if digger is not None:
        digger.take()
    rows = done.step.conversions
    grid = endpoint.soil.grid
    x = [1.5 * round(float(grid.x(int(row))) / 1.5) for row in rows["row"]]
    return set(zip(rows["soil"].tolist(), x, strict=True))


@pytest.fixture
def endpoint() -> SoilEndpoint:
    return SoilEndpoint(flat_soil())


def welcomed(endpoint: SoilEndpoint) -> Digger:
    digger = Digger(endpoint)
    assert endpoint.advance() is not None
    digger.deliver()
    assert digger.exchange.joined
    return digger


def test_no_tick_before_the_expected_machines_have_joined() -> None:
    endpoint = SoilEndpoint(flat_soil(), expected=(1, 2))
    assert endpoint.tick == -1
    Digger(endpoint, 1)
    assert endpoint.advance() is None
    Digger(endpoint, 2)
    done = endpoint.advance()
    assert done is not None
    assert (done.ledger.tick, endpoint.tick) == (0, 0)


def test_welcome_has_the_terrain_and_changes_nothing(endpoint: SoilEndpoint) -> None:
    digger = Digger(endpoint)
    done = endpoint.advance()
    assert done is not None
    assert done.step.conversions.size == done.step.map_updates.size == 0
    assert done.ledger.terrain == endpoint.soil.total_mm3 == done.ledger.start
    sent = digger.deliver()
    assert [type(message) for message in sent] == [SoilHeader, Keyframe]
    assert (sent[1].elevation == endpoint.soil.columns.height).all()
    shown = (sent[1].volume_mm3, sent[1].soil, sent[1].moisture)
    assert all(map(np.array_equal, shown, endpoint.soil.layers))


def test_excavated_volume_is_in_the_conversions_and_the_ledger_balances(
    endpoint: SoilEndpoint,
) -> None:
    digger = welcomed(endpoint)
    before = endpoint.soil.total_mm3
    done = digger.dig()
    assert digger.soil_mm3 == before - endpoint.soil.total_mm3 > 0
    assert done.ledger.imbalance == 0
    assert endpoint.soil.verify_volume()


def test_tick_waits_for_every_machine_unless_wait_is_false(endpoint: SoilEndpoint) -> None:
    digger = welcomed(endpoint)
    assert endpoint.advance() is None
    done = endpoint.advance(wait=False)
    assert done is not None
    assert endpoint.tick == 1
    digger.deliver()
    digger.send(bucket_sweep((0, 0, 1), (0, 0, 1)))
    assert endpoint.advance() is not None


@pytest.mark.parametrize("last_is_valid", [True, False])
def test_released_soil_is_deposited_at_the_last_valid_sweep(
    endpoint: SoilEndpoint, last_is_valid: bool
) -> None:
    digger = welcomed(endpoint)
    digger.dig()
    x, z = DOWN[-1]
    digger.send(bucket_sweep((x, 0.0, z), (x, 0.0, 1.0 if last_is_valid else np.nan)), leave=True)
    left = endpoint.advance()
    assert left is not None
    assert bool(left.step.rejected_tools) is not last_is_valid
    held = left.ledger.absent
    assert held >= digger.soil_mm3 > 0
    heights = endpoint.soil.columns.height.copy()
    assert endpoint.release_absent_soil() == (1,)
    done = endpoint.advance(wait=False)
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    assert done.ledger.terrain == left.ledger.terrain + held
    raised = np.argwhere(endpoint.soil.columns.height > heights + 1e-6)
    # The left end of the lip, position of the first pair of key points, within the relaxation.
    grid = endpoint.soil.grid
    place = np.array([grid.row(x), grid.col(0.6)])
    assert np.hypot(*(raised - place).T).min() < 2.5
    assert endpoint.soil.verify_volume()


def test_soil_of_a_dropped_machine_is_released_where_it_was(endpoint: SoilEndpoint) -> None:
    welcomed(endpoint).dig(x=1.5)
    endpoint.exchange.drop(1)
    assert endpoint.release_absent_soil() == (1,)
    assert {x for _, x in released_soil(endpoint)} == {1.5}


def test_released_soil_has_the_kind_and_moisture_of_the_excavated_soil() -> None:
    grid = Grid(61, 61, 0.2)
    ids = np.full(grid.shape, 1, dtype=np.uint8)
    params = SoilParams(soil="loam", additional_soils=("wet clay",))
    soil = Soil(grid, np.zeros(grid.shape), params, soil=ids, moisture=np.full(grid.shape, 63))
    endpoint = SoilEndpoint(soil)
    digger = welcomed(endpoint)
    digger.dig()
    x, z = DOWN[-1]
    digger.send(bucket_sweep((x, 0.0, z), (x, 0.0, 1.0)), leave=True)
    endpoint.advance()
    loose = soil.columns.loose.copy()
    endpoint.release_absent_soil()
    done = endpoint.advance(wait=False)
    assert done is not None
    rows = done.step.conversions
    assert set(zip(rows["soil"].tolist(), rows["moisture"].tolist(), strict=True)) == {(1, 63)}
    grown = soil.columns.loose > loose
    assert grown.any()
    assert set(soil.columns.loose_moisture[grown].tolist()) == {63}
    assert set(soil.columns.loose_soil[grown].tolist()) == {1}


def test_release_without_absent_soil_does_nothing(endpoint: SoilEndpoint) -> None:
    digger = welcomed(endpoint)
    digger.dig()
    assert endpoint.release_absent_soil() == ()


def test_soil_of_an_ended_session_is_released_beside_the_present_one(
    endpoint: SoilEndpoint,
) -> None:
    crashed = welcomed(endpoint)
    crashed.dig()
    heights = endpoint.soil.columns.height.copy()
    endpoint.exchange.drop(1)
    digger = Digger(endpoint, session_id=5)
    endpoint.advance(wait=False)
    digger.deliver()
    digger.send(bucket_sweep((3.0, 0.0, 1.0), (3.0, 0.0, 1.0)))
    before = endpoint.advance()
    assert before is not None
    held = before.ledger.absent
    assert held > 0
    assert endpoint.release_absent_soil() == (1,)
    digger.take()
    digger.send(bucket_sweep((3.0, 0.0, 1.0), (3.0, 0.0, 1.0)))
    done = endpoint.advance()
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    assert done.ledger.terrain == before.ledger.terrain + held
    raised = np.argwhere(endpoint.soil.columns.height > heights + 1e-6)
    grid = endpoint.soil.grid
    place = np.array([grid.row(DOWN[-1][0]), grid.col(0.6)])  # where the crashed session was
    assert np.hypot(*(raised - place).T).min() < 2.5
    assert endpoint.release_absent_soil() == ()
    digger.take()
    digger.send(bucket_sweep((3.0, 0.0, 1.0), (3.0, 0.0, 1.0)))
    last = endpoint.advance()
    assert last is not None
    digger.take()
    assert (digger.soil_mm3, last.ledger.imbalance) == (0, 0)


def test_machine_that_rejoins_before_the_release_keeps_its_soil(
    endpoint: SoilEndpoint,
) -> None:
    digger = welcomed(endpoint)
    digger.dig()
    digger.send(bucket_sweep((0, 0, 1), (0, 0, 1)), leave=True)
    endpoint.advance()
    digger.deliver()
    digger.exchange.acknowledge_answer()
    assert endpoint.release_absent_soil() == (1,)
    digger.exchange.join(pending_mm3=digger.soil_mm3)
    digger.deliver()
    assert endpoint.release_absent_soil() == ()
    done = endpoint.advance()
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    assert done.ledger.pending == digger.soil_mm3 > 0
    digger.deliver()
    digger.send(bucket_sweep((0, 0, 1), (0, 0, 1)))
    assert endpoint.advance() is not None


def test_release_includes_soil_of_a_machine_that_joins_before_the_tick(
    endpoint: SoilEndpoint,
) -> None:
    digger = welcomed(endpoint)
    digger.dig()
    digger.leave(0.0)
    assert endpoint.release_absent_soil() == (1,)
    restarted = Digger(endpoint, session_id=5)
    done = endpoint.advance()
    assert done is not None
    assert (done.ledger.absent, done.ledger.imbalance) == (0, 0)
    assert done.step.conversions.size > 0
    restarted.deliver()
    assert restarted.exchange.joined
    for _ in range(3):
        restarted.send(bucket_sweep((3.0, 0.0, 1.0), (3.0, 0.0, 1.0)))
        assert endpoint.advance() is not None
        restarted.take()
    assert restarted.soil_mm3 == 0


def test_release_includes_ended_accounts_of_a_machine_that_is_dropped_before_the_tick(
    endpoint: SoilEndpoint,
) -> None:
    crashed = welcomed(endpoint)
    held = crashed.dig().ledger.pending
    endpoint.exchange.drop(1)
    digger = Digger(endpoint, session_id=5)
    endpoint.advance(wait=False)
    digger.deliver()
    last = digger.dig(x=3.0)
    before = last.ledger.absent
    assert before >= held > 0
    assert endpoint.release_absent_soil() == (1,)
    endpoint.exchange.drop(1)
    done = endpoint.advance(wait=False)
    assert done is not None
    assert done.ledger.terrain - last.ledger.terrain == before
    assert done.ledger.absent == last.ledger.pending > 0  # what the dropped machine holds
    assert done.ledger.imbalance == 0
    digger.deliver()
    digger.rejoin()
    assert endpoint.exchange.ledger is not None
    assert endpoint.exchange.ledger.absent == 0


def test_soil_of_each_session_is_released_where_and_as_its_machine_had_it() -> None:
    grid = Grid(61, 61, 0.2)
    soil_ids = np.zeros(grid.shape, dtype=np.uint8)
    soil_ids[int(grid.row(1.5)) :] = 1  # rows begin at +x
    params = SoilParams(soil="loam", additional_soils=("wet clay",))
    soil = Soil(grid, np.zeros(grid.shape), params, soil=soil_ids)
    endpoint = SoilEndpoint(soil)
    crashed = welcomed(endpoint)
    crashed.dig()  # clay at x = 0
    endpoint.exchange.drop(1)
    digger = Digger(endpoint, session_id=5)
    endpoint.advance(wait=False)
    digger.deliver()
    digger.dig(x=3.0)  # loam
    digger.leave(3.0)
    digger.rejoin()
    assert endpoint.release_absent_soil() == (1,)
    assert released_soil(endpoint, digger) == {(1, 0.0)}
    digger.leave(3.0)
    assert endpoint.release_absent_soil() == (1,)
    assert released_soil(endpoint) == {(0, 3.0)}


def test_merged_accounts_are_released_with_the_kind_and_place_of_their_soil(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ended_accounts, "MAX_REJOINABLE_ACCOUNTS", 1)
    grid = Grid(61, 61, 0.2)
    soil_ids = np.zeros(grid.shape, dtype=np.uint8)
    soil_ids[int(grid.row(1.5)) :] = 1  # rows begin at +x
    params = SoilParams(soil="loam", additional_soils=("wet clay",))
    endpoint = SoilEndpoint(Soil(grid, np.zeros(grid.shape), params, soil=soil_ids))
    welcomed(endpoint).dig(x=3.0)  # loam
    for session, x in ((5, 0.0), (9, 0.0), (13, 3.0), (17, None)):
        endpoint.exchange.drop(1)
        digger = Digger(endpoint, session_id=session)
        endpoint.advance(wait=False)
        digger.deliver()
        if x is not None:
            digger.dig(x)
    assert len(endpoint.exchange.accounts.account_numbers) == 3
    assert endpoint.release_absent_soil() == (1,)
    # The three older sessions hold more clay than loam; the last of them was at 0.
    assert released_soil(endpoint, digger) == {(1, 0.0), (0, 3.0)}


def test_released_volume_beyond_the_limit_of_a_row_is_complete() -> None:
    rows = split_into_deposit_requests(2 * MAX_ROW_VOLUME + 5)
    assert rows["volume_mm3"].tolist() == [MAX_ROW_VOLUME, MAX_ROW_VOLUME, 5]

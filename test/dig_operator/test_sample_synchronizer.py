"""Moments: what topics told of one tick, once it is whole."""

from __future__ import annotations

from itertools import permutations

import pytest

from dig_operator.sample_synchronizer import SampleSynchronizer
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.ledger import Ledger

BASE = BaseState((0, 0, 0), (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))
PAYLOAD = PayloadState(0.0, 0.0, 0.0, 0.0)
PARTS = ("joints", "base", "payload", "ledger")


def ledger(tick: int) -> Ledger:
    return Ledger(tick, 0, 0, 0, 0, 0, 0, 0)


def tell(gatherer: SampleSynchronizer, tick: int, *parts: str) -> None:
    """Tell some parts of a tick, all if none is named."""
    for part in parts or PARTS:
        if part == "joints":
            gatherer.add_joints(tick, [float(tick)] * 4)
        elif part == "base":
            gatherer.add_base(tick, BASE)
        elif part == "payload":
            gatherer.add_payload(tick, PAYLOAD)
        else:
            gatherer.add_ledger(ledger(tick))


def test_a_whole_moment_is_given_once() -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    tell(gatherer, 4)
    moment = gatherer.pop_next(4)
    assert moment is not None
    assert (moment.tick, moment.joints, moment.base) == (4, [4.0] * 4, BASE)
    assert (moment.payload, moment.ledger) == (PAYLOAD, ledger(4))
    assert gatherer.pop_next(4) is None


@pytest.mark.parametrize("missing", PARTS)
def test_no_moment_lacks_a_part(missing: str) -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    tell(gatherer, 4, *(part for part in PARTS if part != missing))
    assert gatherer.pop_next(4) is None
    tell(gatherer, 4, missing)
    assert gatherer.pop_next(4) is not None


@pytest.mark.parametrize("order", list(permutations(PARTS)))
def test_parts_come_in_any_order(order: tuple[str, ...]) -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    taken = []
    for part in order:
        tell(gatherer, 7, part)
        taken.append(gatherer.pop_next(7) is not None)
    assert taken == [False, False, False, True]


@pytest.mark.parametrize("old", PARTS)
def test_parts_of_different_ticks_make_no_moment(old: str) -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    tell(gatherer, 4)
    gatherer.pop_next(4)
    tell(gatherer, 5, *(part for part in PARTS if part != old))
    assert gatherer.pop_next(5) is None


def test_the_terrain_must_not_be_older() -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    tell(gatherer, 4)
    assert gatherer.pop_next(3) is None
    assert gatherer.pop_next(4) is not None


def test_the_first_ledger_that_is_not_older_is_taken() -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    tell(gatherer, 4, "joints", "base", "payload")
    for tick in (3, 5, 6):
        gatherer.add_ledger(ledger(tick))
    moment = gatherer.pop_next(9)
    assert moment is not None
    assert (moment.tick, moment.ledger.tick) == (4, 5)


def test_every_moment_is_given_in_order() -> None:
    gatherer = SampleSynchronizer(every_tick=True)
    for tick in (4, 6, 8):
        tell(gatherer, tick)
    given = [gatherer.pop_next(8) for _ in range(4)]
    assert [(m.tick, m.ledger.tick) for m in given if m] == [(4, 4), (6, 6), (8, 8)]
    tell(gatherer, 5)
    assert gatherer.pop_next(8) is None


def test_where_not_every_one_counts_the_newest_is_given_and_none_before_it_after() -> None:
    gatherer = SampleSynchronizer(every_tick=False)
    tell(gatherer, 4)
    tell(gatherer, 6)
    moment = gatherer.pop_next(6)
    assert moment is not None
    assert moment.tick == 6
    tell(gatherer, 5)
    assert gatherer.pop_next(6) is None


def test_where_not_every_one_counts_terrain_and_ledger_may_be_older() -> None:
    gatherer = SampleSynchronizer(every_tick=False)
    tell(gatherer, 4, "joints", "base", "payload")
    gatherer.add_ledger(ledger(2))
    assert gatherer.pop_next(-1) is None
    moment = gatherer.pop_next(2)
    assert moment is not None
    assert (moment.tick, moment.ledger.tick) == (4, 2)


@pytest.mark.parametrize("every_tick", [True, False])
def test_what_is_never_made_whole_is_forgotten(every_tick: bool) -> None:
    gatherer = SampleSynchronizer(every_tick=every_tick)
    for tick in range(10_000):
        tell(gatherer, tick, "joints", "ledger")
    assert len(gatherer._partial_samples) + len(gatherer._ledgers) < 300
    tell(gatherer, 10_000)
    assert gatherer.pop_next(10_000) is not None

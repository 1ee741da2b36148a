"""SampleSynchronizer: the messages of a tick, once they are complete."""

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
    return Ledger(1, tick, 0, 0, 0, 0, 0, 0, 0)


def add(synchronizer: SampleSynchronizer, tick: int, *parts: str) -> None:
    """Add messages of a tick, all if none is named."""
    for part in parts or PARTS:
        if part == "joints":
            synchronizer.add_joints(tick, [float(tick)] * 4)
        elif part == "base":
            synchronizer.add_base(tick, BASE)
        elif part == "payload":
            synchronizer.add_payload(tick, PAYLOAD)
        else:
            synchronizer.add_ledger(ledger(tick))


def test_complete_sample_is_returned_once() -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    add(synchronizer, 4)
    sample = synchronizer.pop_next(4)
    assert sample is not None
    assert (sample.tick, sample.joints, sample.base) == (4, [4.0] * 4, BASE)
    assert (sample.payload, sample.ledger) == (PAYLOAD, ledger(4))
    assert synchronizer.pop_next(4) is None


@pytest.mark.parametrize("missing", PARTS)
def test_incomplete_sample_is_not_returned(missing: str) -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    add(synchronizer, 4, *(part for part in PARTS if part != missing))
    assert synchronizer.pop_next(4) is None
    add(synchronizer, 4, missing)
    assert synchronizer.pop_next(4) is not None


@pytest.mark.parametrize("order", list(permutations(PARTS)))
def test_messages_arrive_in_any_order(order: tuple[str, ...]) -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    is_complete = []
    for part in order:
        add(synchronizer, 7, part)
        is_complete.append(synchronizer.pop_next(7) is not None)
    assert is_complete == [False, False, False, True]


@pytest.mark.parametrize("old", PARTS)
def test_messages_of_different_ticks_make_no_sample(old: str) -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    add(synchronizer, 4)
    synchronizer.pop_next(4)
    add(synchronizer, 5, *(part for part in PARTS if part != old))
    assert synchronizer.pop_next(5) is None


def test_terrain_must_not_be_older_than_the_sample() -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    add(synchronizer, 4)
    assert synchronizer.pop_next(3) is None
    assert synchronizer.pop_next(4) is not None


def test_first_ledger_that_is_not_older_is_used() -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    add(synchronizer, 4, "joints", "base", "payload")
    for tick in (3, 5, 6):
        synchronizer.add_ledger(ledger(tick))
    sample = synchronizer.pop_next(9)
    assert sample is not None
    assert (sample.tick, sample.ledger.tick) == (4, 5)


def test_every_sample_is_returned_in_order() -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    for tick in (4, 6, 8):
        add(synchronizer, tick)
    samples = [synchronizer.pop_next(8) for _ in range(4)]
    assert [(s.tick, s.ledger.tick) for s in samples if s] == [(4, 4), (6, 6), (8, 8)]
    add(synchronizer, 5)
    assert synchronizer.pop_next(8) is None


def test_samples_before_a_tick_are_skipped() -> None:
    synchronizer = SampleSynchronizer(every_tick=True)
    add(synchronizer, 0)
    add(synchronizer, 2)
    synchronizer.skip_to(2)
    sample = synchronizer.pop_next(2)
    assert sample is not None
    assert sample.tick == 2
    synchronizer.skip_to(0)
    add(synchronizer, 2)
    assert synchronizer.pop_next(2) is None, "no sample is returned twice"


def test_newest_sample_is_returned_and_older_ones_are_dropped_in_real_time() -> None:
    synchronizer = SampleSynchronizer(every_tick=False)
    add(synchronizer, 4)
    add(synchronizer, 6)
    sample = synchronizer.pop_next(6)
    assert sample is not None
    assert sample.tick == 6
    add(synchronizer, 5)
    assert synchronizer.pop_next(6) is None


def test_terrain_and_ledger_may_be_older_in_real_time() -> None:
    synchronizer = SampleSynchronizer(every_tick=False)
    add(synchronizer, 4, "joints", "base", "payload")
    synchronizer.add_ledger(ledger(2))
    assert synchronizer.pop_next(-1) is None
    sample = synchronizer.pop_next(2)
    assert sample is not None
    assert (sample.tick, sample.ledger.tick) == (4, 2)


@pytest.mark.parametrize("every_tick", [True, False])
def test_number_of_incomplete_samples_is_limited(every_tick: bool) -> None:
    synchronizer = SampleSynchronizer(every_tick=every_tick)
    for tick in range(10_000):
        add(synchronizer, tick, "joints", "ledger")
    assert synchronizer.num_pending < 300
    add(synchronizer, 10_000)
    assert synchronizer.pop_next(10_000) is not None

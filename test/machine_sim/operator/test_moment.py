"""Moments: what topics told of one tick, once it is whole."""

from __future__ import annotations

from itertools import permutations

import pytest

from machine_sim.operator.moment import MomentGatherer
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.ledger import Ledger

BASE = BaseState((0, 0, 0), (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))
PAYLOAD = PayloadState(0.0, 0.0, 0.0, 0.0)
PARTS = ("joints", "base", "payload", "ledger")


def ledger(tick: int) -> Ledger:
    return Ledger(tick, 0, 0, 0, 0, 0, 0, 0)


def tell(gatherer: MomentGatherer, tick: int, *parts: str) -> None:
    """Tell some parts of a tick, all if none is named."""
    for part in parts or PARTS:
        if part == "joints":
            gatherer.joints(tick, [float(tick)] * 4)
        elif part == "base":
            gatherer.base(tick, BASE)
        elif part == "payload":
            gatherer.payload(tick, PAYLOAD)
        else:
            gatherer.ledger(ledger(tick))


def test_a_whole_moment_is_given_once() -> None:
    gatherer = MomentGatherer()
    tell(gatherer, 4)
    moment = gatherer.take(4)
    assert moment is not None
    assert (moment.tick, moment.joints, moment.base) == (4, [4.0] * 4, BASE)
    assert (moment.payload, moment.ledger) == (PAYLOAD, ledger(4))
    assert gatherer.take(4) is None


@pytest.mark.parametrize("missing", PARTS)
def test_no_moment_lacks_a_part(missing: str) -> None:
    gatherer = MomentGatherer()
    tell(gatherer, 4, *(part for part in PARTS if part != missing))
    assert gatherer.take(4) is None
    tell(gatherer, 4, missing)
    assert gatherer.take(4) is not None


@pytest.mark.parametrize("order", list(permutations(PARTS)))
def test_parts_come_in_any_order(order: tuple[str, ...]) -> None:
    gatherer = MomentGatherer()
    taken = []
    for part in order:
        tell(gatherer, 7, part)
        taken.append(gatherer.take(7) is not None)
    assert taken == [False, False, False, True]


@pytest.mark.parametrize("old", PARTS)
def test_parts_of_different_ticks_make_no_moment(old: str) -> None:
    gatherer = MomentGatherer()
    tell(gatherer, 4)
    gatherer.take(4)
    tell(gatherer, 5, *(part for part in PARTS if part != old))
    assert gatherer.take(5) is None


def test_the_terrain_must_not_be_older() -> None:
    gatherer = MomentGatherer()
    tell(gatherer, 4)
    assert gatherer.take(3) is None
    assert gatherer.take(4) is not None


def test_terrain_and_ledger_may_be_newer() -> None:
    gatherer = MomentGatherer()
    tell(gatherer, 4)
    gatherer.ledger(ledger(6))
    moment = gatherer.take(9)
    assert moment is not None
    assert (moment.tick, moment.ledger.tick) == (4, 6)


def test_the_newest_moment_is_given_and_none_before_it_after() -> None:
    gatherer = MomentGatherer()
    tell(gatherer, 4)
    tell(gatherer, 6)
    moment = gatherer.take(6)
    assert moment is not None
    assert moment.tick == 6
    tell(gatherer, 5)
    assert gatherer.take(6) is None

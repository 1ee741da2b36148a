"""Volume in flight is counted from the rows that are not acknowledged."""

import pytest
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import MachineHeader, RowRange, Verb
from msg_bridge.contract.rows import CONVERSION, ConversionKind, empty_rows
from msg_bridge.exchange.ended_accounts import MAX_REJOINABLE_ACCOUNTS
from msg_bridge.exchange.ledger_accounts import LedgerAccounts
from msg_bridge.exchange.machine_account import signed_volume


def moved(*rows: tuple[int, ConversionKind, int]):
    """Return CONVERSION rows of (machine id, kind, volume)."""
    conversions = empty_rows(CONVERSION, len(rows))
    for name, values in zip(
        ("machine_id", "kind", "volume_mm3"), zip(*rows, strict=True), strict=True
    ):
        conversions[name] = values
    return conversions


def header(
    through: int, *, machine_id: int = 1, volume: int = 0, verb: Verb = Verb.STEP
) -> MachineHeader:
    """Return the header of a machine that has applied the rows up to a number."""
    return MachineHeader(
        1, machine_id, 1, 1, verb, conversions_received=through, pending_mm3=volume
    )


@pytest.fixture
def accounts() -> LedgerAccounts:
    """Return accounts of two machines; rows 1 to 4 and 5 to 6 were published."""
    accounts = LedgerAccounts()
    accounts.join(1, 0)
    accounts.join(2, 0)
    first = moved(
        (1, ConversionKind.EXCAVATE, 100),
        (2, ConversionKind.EXCAVATE, 7),
        (1, ConversionKind.DEPOSIT, 30),
        (1, ConversionKind.REJECT, 5),
    )
    accounts.add_in_flight(RowRange(1, 4), first)
    accounts.add_in_flight(
        RowRange(5, 2), moved((1, ConversionKind.EXCAVATE, 1000), (1, ConversionKind.OUTSIDE, 200))
    )
    return accounts


def test_volumes_beyond_32_bits_are_counted_exactly():
    rows = moved(
        *[(1, ConversionKind.EXCAVATE, 2**32 - 1)] * 3, (1, ConversionKind.OUTSIDE, 2**32 - 2)
    )
    assert signed_volume(rows) == 2 * (2**32 - 1) + 1
    assert signed_volume(rows[:0]) == 0


def test_rows_are_in_flight_until_their_machine_has_applied_them(accounts):
    assert accounts.in_flight(1) == 870
    assert accounts.in_flight(2) == 7
    accounts.update_totals(header(4))
    assert accounts.in_flight(1) == 800
    accounts.update_totals(header(6))
    assert accounts.in_flight(1) == 0
    assert accounts.in_flight(2) == 7


def test_rows_published_together_may_be_acknowledged_in_part(accounts):
    accounts.update_totals(header(1))
    assert accounts.in_flight(1) == 770
    assert accounts.backlog(1)["volume_mm3"].tolist() == [30, 5, 1000, 200]
    accounts.update_totals(header(5))
    assert accounts.backlog(1)["volume_mm3"].tolist() == [200]


@pytest.mark.parametrize(("through", "volume"), [(0, 0), (1, 100), (3, 70), (5, 1070), (6, 870)])
def test_rejoining_volume_follows_from_the_applied_rows(accounts, through, volume):
    accounts.leave(1)
    with raises(ErrorCode.REJOIN_VOLUME):
        accounts.rejoin(header(through, volume=volume + 1, verb=Verb.REJOIN), 6)
    accounts.rejoin(header(through, volume=volume, verb=Verb.REJOIN), 6)
    assert accounts.in_flight(1) + volume == 870


def test_ledger_contains_all_accounts(accounts):
    accounts.update_totals(header(4, volume=70))
    accounts.leave(1)
    ledger = accounts.ledger(1, 3, 5000)
    assert (ledger.tick, ledger.terrain, ledger.start) == (3, 5000, ledger.total)
    assert (ledger.in_flight, ledger.pending, ledger.absent, ledger.outside) == (807, 0, 70, 200)
    later = accounts.ledger(1, 4, 4990)
    assert (later.start, later.imbalance) == (ledger.start, -10)
    assert accounts.absent == (1,)


NUM_SESSIONS = 1000


def crashed_often(*kinds: ConversionKind) -> LedgerAccounts:
    """Return accounts of a machine that crashed in many sessions, after a row of each kind in each.

    The rows of session k have a volume of k + 1.
    """
    accounts = LedgerAccounts()
    for k in range(NUM_SESSIONS):
        last = k * len(kinds)
        accounts.join(1, last)
        rows = moved(*[(1, kind, k + 1) for kind in kinds])
        accounts.add_in_flight(RowRange(last + 1, len(kinds)), rows)
        accounts.leave(1)
    return accounts


def test_number_of_ended_accounts_is_bounded():
    accounts = crashed_often(ConversionKind.EXCAVATE)
    ended = MAX_REJOINABLE_ACCOUNTS + 1
    assert len(accounts.account_numbers) == ended + 1
    ledger = accounts.ledger(1, 1, 0)
    assert ledger.total == sum(range(1, NUM_SESSIONS + 1))
    released = accounts.release(1)
    assert sum(released.values()) == ledger.total
    assert len(released) == ended + 1
    assert len(accounts.account_numbers) == 1


def test_machine_can_rejoin_with_one_of_the_last_ended_accounts():
    accounts = crashed_often(ConversionKind.EXCAVATE)
    oldest = NUM_SESSIONS - MAX_REJOINABLE_ACCOUNTS  # soil and row of the oldest such session
    with raises(ErrorCode.REJOIN_VOLUME):
        accounts.rejoin(header(oldest - 1, volume=oldest - 1, verb=Verb.REJOIN), NUM_SESSIONS)
    accounts.rejoin(header(oldest, volume=oldest, verb=Verb.REJOIN), NUM_SESSIONS)
    assert accounts.ledger(1, 1, 0).pending == oldest
    assert accounts.ledger(1, 1, 0).total == sum(range(1, NUM_SESSIONS + 1))
    assert len(accounts.account_numbers) == MAX_REJOINABLE_ACCOUNTS + 2


def test_ended_accounts_without_volume_are_discarded_by_a_release():
    accounts = crashed_often(ConversionKind.EXCAVATE, ConversionKind.DEPOSIT)
    assert accounts.absent == ()
    assert len(accounts.account_numbers) == MAX_REJOINABLE_ACCOUNTS + 1
    assert accounts.machines_with_ended_accounts == (1,)
    assert accounts.release_ended(1) == {}
    assert len(accounts.account_numbers) == 1
    assert accounts.machines_with_ended_accounts == ()

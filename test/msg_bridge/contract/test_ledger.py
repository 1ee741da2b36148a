from dataclasses import replace

from msg_bridge.contract.ledger import Ledger

BALANCED = Ledger(
    run_id=1,
    tick=7,
    terrain=10**15,
    in_flight=-5,
    pending=3,
    particles=40,
    absent=2,
    outside=1,
    start=10**15 + 41,
)


def test_closed_ledger_has_no_imbalance() -> None:
    assert BALANCED.imbalance == 0


def test_1_mm3_in_any_account_is_an_imbalance() -> None:
    for name in ("terrain", "in_flight", "pending", "particles", "absent", "outside"):
        lost = replace(BALANCED, **{name: getattr(BALANCED, name) - 1})
        assert lost.imbalance == -1

"""MembershipLog: one line per machine that joins or leaves."""

from __future__ import annotations

from soil_sim.node.membership_log import MembershipLog


def test_each_change_gives_one_line() -> None:
    lines: list[str] = []
    log = MembershipLog(lines.append, {1: "/excavator", 2: "/dumper"})
    log.update((1,), 0)
    log.update((1,), 1)
    log.update((1, 2), 7)
    log.update((2,), 9)
    log.remove(2)  # dropped: logged by the caller
    log.update((), 10)
    log.update((2,), 20)
    assert lines == [
        "/excavator (machine_id 1) joined in tick 0",
        "/dumper (machine_id 2) joined in tick 7",
        "/excavator (machine_id 1) left in tick 9",
        "/dumper (machine_id 2) joined in tick 20",
    ]


def test_machines_join_again_in_a_new_run() -> None:
    lines: list[str] = []
    log = MembershipLog(lines.append, {})
    log.update((3,), 4)
    log.start_run()
    log.update((3,), 0)
    assert lines == [f"a machine (machine_id 3) joined in tick {tick}" for tick in (4, 0)]

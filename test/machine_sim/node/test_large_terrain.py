"""A machine on a large terrain receives its maps only to begin a run and to join it."""

from __future__ import annotations

from support.node_scenes import Scene

from msg_bridge.testing.ros_context import Ros

NUM_POINTS = 521
"""Rows and columns of a terrain of more than 513 x 513 columns."""


def test_machine_that_takes_part_does_not_receive_large_maps(ros: Ros) -> None:
    scene = Scene(ros, sync="realtime", **{"site.num_points": NUM_POINTS})
    machine = scene.machine()

    def num_subscriptions() -> int:
        return scene.soil.count_subscribers("/terrain/map")

    scene.until_tick(5)
    ros.spin_until(lambda: num_subscriptions() == 0, what="the end of the subscription")
    run_id = machine.run.facts.run_id
    assert scene.trigger("/sim/reset").success
    ros.spin_until(lambda: machine.run.facts.run_id > run_id, what="the next run")
    ros.spin_until(lambda: scene.joined == (1,) and scene.tick > 5, what="its ticks")
    ros.spin_until(lambda: num_subscriptions() == 0, what="the end of the subscription")
    scene.soil.run._drop(1)
    scene.more_ticks(1)
    assert scene.joined == ()
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to rejoin")
    scene.more_ticks(5)
    assert scene.ledgers[-1].imbalance == scene.ledgers[-1].absent == 0


def test_machine_receives_all_maps_of_a_small_terrain(ros: Ros) -> None:
    scene = Scene(ros)
    scene.machine()
    scene.until_tick(50)
    ros.spin_for(0.6)  # longer than the period of the check
    assert scene.soil.count_subscribers("/terrain/map") == 1

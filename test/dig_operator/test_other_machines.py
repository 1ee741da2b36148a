"""OtherMachines: states by tick, what is missing, and names that cannot be right."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from dig_operator.machine_topics import subscribe_to_machines
from dig_operator.other_machines import OtherMachines, check_other_machines
from machine_sim.machine import load_machine_spec
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError

TRUCK = "/site/truck"
CONFIG = yaml.safe_dump({"machines": {"truck": {"machine": "machines/dumper.yaml"}}})
BASE = BaseState((1.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.3, 0.0, 0.0), (0.0, 0.0, 0.0))
PAYLOAD = PayloadState(bank_m3=2.0, loose_m3=2.4, mass_kg=3200.0, fill=0.4)


def machines(*ticks: int) -> OtherMachines:
    """Return a watched truck with complete messages of some ticks."""
    others = OtherMachines([TRUCK], "/")
    others.set_config(TRUCK, CONFIG)
    for tick in ticks:
        others.add_joints(TRUCK, tick, [0.0])
        others.add_base(TRUCK, tick, BASE)
        others.add_payload(TRUCK, tick, PAYLOAD)
    return others


def test_state_is_that_of_the_messages() -> None:
    (truck,) = machines(10).observe(10, 0.01)
    assert truck.name == TRUCK
    assert truck.spec.name == "dumper"
    assert (truck.fill, truck.bank_m3, truck.age) == (0.4, 2.0, 0.0)
    assert truck.speed == pytest.approx(0.3)
    assert truck.base_position.tolist() == [1.0, 2.0, 0.0]


def test_newest_state_up_to_a_tick_has_its_age() -> None:
    others = machines(10, 12, 20)
    (truck,) = others.observe(15, 0.01)
    assert truck.age == pytest.approx(0.03)
    (truck,) = others.observe(20, 0.01)
    assert truck.age == 0.0


def test_machine_is_missing_until_all_its_messages_and_its_file_are_known() -> None:
    others = OtherMachines([TRUCK], "/")
    assert others.unseen() == (TRUCK,)
    others.add_base(TRUCK, 4, BASE)
    others.set_config(TRUCK, CONFIG)
    others.add_joints(TRUCK, 4, [0.0])
    assert others.missing(4) == others.unseen() == (TRUCK,), "without its payload"
    others.add_payload(TRUCK, 4, PAYLOAD)
    assert others.missing(4) == others.unseen() == ()
    assert others.missing(6) == (TRUCK,)
    others.start_run()
    assert others.unseen() == (TRUCK,)


def test_ticks_before_the_first_state_of_each_machine_are_not_waited_for() -> None:
    others = machines(4, 6)
    assert others.first_tick == 4
    others.observe(4, 0.01)
    assert others.first_tick == 0, "no limit once a state was used"
    assert machines().first_tick == 0, "no limit while none is known: it can still arrive"


def test_joint_states_that_arrive_before_the_configuration_are_used() -> None:
    others, callbacks = OtherMachines([TRUCK], "/"), {}
    subscribe_to_machines(
        others,
        lambda kind, topic, profile, callback: callbacks.update({topic: callback}),
        lambda stamp: stamp.sec,
    )
    stamp = Time(sec=8)
    (joint,) = load_machine_spec(find_config("machines/dumper.yaml")).joint_names
    joints = JointState(name=[joint], position=[0.25])
    joints.header.stamp = stamp
    callbacks[f"{TRUCK}/joint_states"](joints)
    callbacks["/site/config"](String(data=CONFIG))
    others.add_base(TRUCK, 8, BASE)
    others.add_payload(TRUCK, 8, PAYLOAD)
    assert others.missing(8) == ()


def test_messages_that_cannot_be_used_are_not_collected_for_ever() -> None:
    others = OtherMachines([TRUCK], "/")
    for tick in range(1000):
        others.add_base(TRUCK, tick, BASE)
    others.set_config(TRUCK, CONFIG)
    others.add_joints(TRUCK, 0, [0.0])
    others.add_payload(TRUCK, 0, PAYLOAD)
    assert others.observe(1000, 0.01) == (), "the message of tick 0 was dropped"


def test_configuration_without_the_machine_is_an_error() -> None:
    others = OtherMachines(["/site/lorry"], "/")
    with pytest.raises(CodecError, match="other_machines"):
        others.set_config("/site/lorry", CONFIG)


@pytest.mark.parametrize("name", ["truck", "/site/truck/", "/", "/site/digger"])
def test_name_that_cannot_be_another_machine_is_an_error(name: str) -> None:
    with pytest.raises(ParameterError, match="other_machines"):
        check_other_machines([TRUCK, name], "/site/digger")


def test_points_cover_the_machine() -> None:
    (truck,) = machines(0).observe(0, 0.01)
    low, high = truck.points.min(axis=0), truck.points.max(axis=0)
    assert np.ptp(truck.points[:, 0]) > 4.0
    assert low[2] < 0.3
    assert high[2] > 2.2

"""Subscriptions of an operator to the state of other machines."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from dig_operator.other_machines import OtherMachines
from msg_bridge.codec import qos
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import from_payload_array
from msg_bridge.codec.poses import from_odometry
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.contract import topics
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.topics import resolve

__all__ = ["joint_angles", "subscribe_to_machines"]

_MAX_EARLY_MESSAGES = 10
"""Number of joint states of a machine that are kept until its configuration arrives."""


class Subscribe(Protocol):
    """Subscribes to a topic."""

    def __call__(
        self, msg_type: Any, topic: str, profile: Any, callback: Callable[[Any], None]
    ) -> None: ...


def joint_angles(msg: JointState, names: Sequence[str]) -> list[float]:
    """Return the angles of the named joints [rad], in the order of `names`.

    Raises:
        CodecError: VALUE: an angle is missing or not finite.
    """
    angle_of = dict(zip(msg.name, msg.position, strict=False))
    angles = [angle_of.get(name, math.nan) for name in names]
    if not all(map(math.isfinite, angles)):
        raise CodecError(
            f"the joint states need a finite angle of {', '.join(names)}", ErrorCode.VALUE
        )
    return angles


def subscribe_to_machines(
    others: OtherMachines, subscribe: Subscribe, tick_of: Callable[[Time], int | None]
) -> None:
    """Subscribe to configuration, joints, pose and payload of each machine.

    Args:
        others: receives them.
        subscribe: subscribes to a topic.
        tick_of: the tick that ended at a stamp; None while it cannot be known.
    """

    # Joint states that arrived before the configuration, which names the joints: in lockstep they
    # are not published again once the machine has made another tick.
    early: dict[str, deque[JointState]] = {
        name: deque(maxlen=_MAX_EARLY_MESSAGES) for name in others.names
    }

    def on_joints(name: str, msg: JointState) -> None:
        tick, names = tick_of(msg.header.stamp), others.joint_names(name)
        if not names:
            early[name].append(msg)
        elif tick is not None:
            others.add_joints(name, tick, joint_angles(msg, names))

    def on_odom(name: str, msg: Odometry) -> None:
        if (tick := tick_of(msg.header.stamp)) is not None:
            others.add_base(name, tick, from_odometry(msg))

    def on_payload(name: str, msg: Float64MultiArray) -> None:
        payload = from_payload_array(msg)
        if (tick := tick_of(stamp_from_seconds(payload.time_s))) is not None:
            others.add_payload(name, tick, payload)

    def on_config(name: str, msg: String) -> None:
        others.set_config(name, msg.data)
        messages = list(early[name])
        early[name].clear()
        for message in messages:
            on_joints(name, message)

    for name in others.names:
        config_topic = resolve(topics.MACHINE_CONFIG, others.node_namespace(name))
        subscribe(String, config_topic, qos.TRANSIENT_LOCAL, partial(on_config, name))
        for kind, topic, callback in (
            (JointState, topics.JOINT_STATES, on_joints),
            (Odometry, topics.ODOM, on_odom),
            (Float64MultiArray, topics.PAYLOAD, on_payload),
        ):
            subscribe(kind, resolve(topic, name), qos.STATE, partial(callback, name))

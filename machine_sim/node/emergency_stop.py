"""Emergency stop of the machines of a node, for publishers of any QoS.

DDS connects a publisher with a subscription that requests no more than it offers. So there are
several subscriptions side by side:

- a reliable one: a message of a reliable publisher is not lost;
- a best-effort one, for best-effort publishers, which the reliable one does not receive;
- once there is a transient-local publisher, one that receives what it published before: it may have
  pressed the stop before this node existed, or was discovered.

A message of a reliable publisher arrives on two or three of them. A copy on the best-effort
subscription is ignored: it can arrive after a later message that was lost there, and would undo it.
What a transient-local publisher published before can press the stop, but release only what was
pressed by such a message.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import Bool

from machine_sim.node.machine_instance import MachineInstance
from msg_bridge.contract import topics
from msg_bridge.nodes.diagnostics import Diagnostics

__all__ = ["EmergencyStops", "StopSubscriptions"]

_SEARCH_PERIOD = 0.25
"""Wall time between two searches for a transient-local publisher [s]."""

_DEPTH = 10
_MAX_REMEMBERED = 64
"""Number of messages whose copies are recognised."""

_CONDITION = "emergency stop"


class EmergencyStops:
    """Emergency stops of the machines of a node, with log and diagnostics."""

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        instances: Sequence[MachineInstance],
        on_change: Callable[[], None],
    ) -> None:
        """
        Args:
            node: the machine node.
            diagnostics: its diagnostics.
            instances: its machines.
            on_change: called after a stop was pressed or released.
        """
        self._on_change = on_change
        self._node, self._diagnostics, self._instances = node, diagnostics, instances
        self._has_changed = False
        self._subscriptions = [
            StopSubscriptions(
                node,
                instance.topic_prefix + topics.EMERGENCY_STOP,
                partial(self._receive, instance),
            )
            for instance in instances
        ]

    def take_all(self) -> None:
        """Take the messages that have arrived, so that they apply to the next tick.

        A change is reported at once: a page must not show an older state for a second.
        """
        for subscriptions in self._subscriptions:
            subscriptions.take_all()
        if self._has_changed:
            self._has_changed = False
            self._diagnostics.publish()

    def _receive(self, instance: MachineInstance, is_pressed: bool) -> None:
        was_pressed = instance.arbiter.is_stopped
        instance.arbiter.emergency_stop(is_pressed)
        if is_pressed == was_pressed:
            return
        self._has_changed = True
        name = instance.name or "the machine"
        if is_pressed:
            self._node.get_logger().warning(
                f"emergency stop of {name} is pressed: it holds until the stop is released"
            )
        else:
            self._node.get_logger().info(f"emergency stop of {name} is released")
        stopped = [
            each.name or "the machine" for each in self._instances if each.arbiter.is_stopped
        ]
        if stopped:
            text = f"emergency stop is pressed: {', '.join(stopped)}"
            self._diagnostics.problem(text, condition=_CONDITION)
        else:
            self._diagnostics.clear(_CONDITION)
        self._on_change()


class StopSubscriptions:
    """Subscriptions to the emergency stop of one machine."""

    def __init__(self, node: Node, topic: str, receive: Callable[[bool], None]) -> None:
        """
        Args:
            node: the machine node.
            topic: name of the topic.
            receive: called with each message: whether the stop is pressed.
        """
        self._node, self._receive = node, receive
        self._topic = node.resolve_topic_name(topic)
        self._source_times: deque[int] = deque(maxlen=_MAX_REMEMBERED)  # of live messages
        self._is_pressed_by_history = False
        self._num_publishers = 0
        self._subscriptions: list[tuple[Subscription, Callable[[Bool, Any], None]]] = []
        self._subscribe(ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE, self._take_live)
        self._subscribe(
            ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE, self._take_best_effort
        )
        node.create_timer(_SEARCH_PERIOD, self._find_transient_local)

    def _subscribe(
        self,
        reliability: ReliabilityPolicy,
        durability: DurabilityPolicy,
        take: Callable[[Bool, Any], None],
    ) -> None:
        profile = QoSProfile(depth=_DEPTH, reliability=reliability, durability=durability)
        subscription = self._node.create_subscription(Bool, self._topic, take, profile)
        self._subscriptions.append((subscription, take))

    def _find_transient_local(self) -> None:
        """Subscribe to earlier messages once a publisher keeps them.

        Not before: every other publisher would log that its QoS is incompatible.
        """
        num_publishers = self._node.count_publishers(self._topic)
        if num_publishers == self._num_publishers or len(self._subscriptions) > 2:
            return
        self._num_publishers = num_publishers
        transient_local = DurabilityPolicy.TRANSIENT_LOCAL
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        if any(each.qos_profile.durability is transient_local for each in publishers):
            self._subscribe(ReliabilityPolicy.RELIABLE, transient_local, self._take_history)

    def take_all(self) -> None:
        """Take the messages that have arrived."""
        for subscription, take in self._subscriptions:
            with subscription.handle:
                for _ in range(_DEPTH):
                    found = subscription.handle.take_message(Bool, False)
                    if found is None:
                        break
                    take(*found)

    def _take_live(self, msg: Bool, info: Any) -> None:
        self._source_times.append(info["source_timestamp"])
        self._is_pressed_by_history = False
        self._receive(bool(msg.data))

    def _take_best_effort(self, msg: Bool, info: Any) -> None:
        if info["source_timestamp"] not in self._source_times:
            self._take_live(msg, info)

    def _take_history(self, msg: Bool, info: Any) -> None:
        if info["source_timestamp"] in self._source_times:
            return
        if msg.data or self._is_pressed_by_history:
            self._is_pressed_by_history = bool(msg.data)
            self._receive(bool(msg.data))

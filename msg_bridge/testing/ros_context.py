"""Nodes, topics and services in a test's own context and executor."""

from __future__ import annotations

import gc
import inspect
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from msg_bridge.codec.qos import ROWS
from msg_bridge.nodes.ros_parameters import reject_unknown_overrides

__all__ = ["DEADLINE", "LeakedNodesError", "Ros"]

DEADLINE = 20.0
"""How long to wait for anything [s]: far longer than it takes, since a machine may be busy."""

_SPIN_TIMEOUT = 0.02  # s between two looks at a condition

N = TypeVar("N", bound=Node)


class LeakedNodesError(AssertionError):
    """A test made nodes in this context and left them."""


class Ros:
    """A ROS context with one executor, both of one test.

    Nothing happens in it unless the test spins: `spin_until`, `spin_for` or `call`.

    Attributes:
        domain: its domain id.
        context: for what is made past this class.
        executor: holds every node made here.
    """

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.context = Context()
        rclpy.init(
            args=[],
            context=self.context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.executor = SingleThreadedExecutor(context=self.context)
        self._nodes: list[Node] = []
        self._helper: Node | None = None
        self._failure_checks: list[Callable[[], str | None]] = []

    def node(self, name: str = "test", **kwargs: Any) -> Node:
        """A plain node; `kwargs` are those of `rclpy.node.Node`."""
        return self.add(Node, name, **kwargs)

    def add(
        self,
        node_class: Callable[..., N],
        *args: Any,
        parameters: Mapping[str, Any] | None = None,
        **kwargs: Any,
    ) -> N:
        """Build a node in the test's context and have it spun.

        Args:
            node_class: passes its keyword arguments on to `rclpy.node.Node`, as all nodes of
                this package do.
            args, kwargs: its own arguments, and those of `rclpy.node.Node` such as `namespace`.
            parameters: values by name, as from a parameter file.

        Raises:
            ParameterError: the node does not have one of the parameters.
        """
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        try:
            node = node_class(*args, context=self.context, parameter_overrides=overrides, **kwargs)
            reject_unknown_overrides(node)
        except BaseException:
            # A constructor that raised leaves half a node behind, kept alive by the traceback.
            for stranger in self._untracked_nodes():
                stranger.destroy_node()
            raise
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def remove(self, node: Node) -> None:
        """Destroy a node before the test ends, as if its process had ended."""
        self.executor.remove_node(node)
        self._nodes.remove(node)
        if node is self._helper:
            self._helper = None
        node.destroy_node()

    def spin_until(
        self, condition: Callable[[], Any], timeout: float = DEADLINE, what: str = ""
    ) -> None:
        """Let nodes work until a condition holds.

        Args:
            condition: looked at again after every callback.
            timeout: [s], wall time.
            what: what is waited for, for the message; the condition's source by default.

        Raises:
            AssertionError: it did not come to hold in time, or a process of `ros_process` that
                should be running has ended.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            for fail_on in self._failure_checks:
                failure_reason = fail_on()
                assert failure_reason is None, (
                    f"{failure_reason}\nwhile waiting for: {what or _text(condition)}"
                )
            assert time.monotonic() < deadline, (
                f"{timeout:g} s passed while waiting for: {what or _text(condition)}"
            )
            self.executor.spin_once(timeout_sec=_SPIN_TIMEOUT)

    def spin_for(self, seconds: float) -> None:
        """Let nodes work for a time, to see that something does *not* happen."""
        end = time.monotonic() + seconds
        self.spin_until(lambda: time.monotonic() >= end, seconds + DEADLINE)

    def collect(self, topic: str, of: type, qos: QoSProfile = ROWS) -> list[Any]:
        """A list that every message on a topic is added to while the test spins.

        Args:
            qos: see `msg_bridge.codec.qos`; LATCHED to get what was published before.
        """
        received: list[Any] = []
        self.helper.create_subscription(of, topic, received.append, qos)
        return received

    def publisher(
        self, topic: str, of: type, qos: QoSProfile = ROWS, *, subscriptions: int = 0
    ) -> Publisher:
        """A publisher, returned once it has found that many subscriptions."""
        publisher = self.helper.create_publisher(of, topic, qos)
        self.spin_until(
            lambda: publisher.get_subscription_count() >= subscriptions,
            what=f"{subscriptions} subscriptions to {topic}",
        )
        return publisher

    def call(self, of: type, name: str, request: Any, timeout: float = DEADLINE) -> Any:
        """Call a service and return its response.

        Args:
            of: the service's type, e.g. `std_srvs.srv.Trigger`.
            request: e.g. `Trigger.Request()`.

        Raises:
            AssertionError: there is no such service, or it did not answer in time.
        """
        client = self.helper.create_client(of, name)
        try:
            self.spin_until(client.service_is_ready, timeout, f"the service {name}")
            future = client.call_async(request)
            self.spin_until(future.done, timeout, f"the answer of {name}")
            return future.result()
        finally:
            self.helper.destroy_client(client)

    def node_names(self) -> list[str]:
        """Full names of all nodes in the domain, as far as they have been discovered."""
        return sorted(self.helper.get_fully_qualified_node_names())

    @property
    def helper(self) -> Node:
        """The node behind `collect`, `publisher`, `call`; made when first needed."""
        if self._helper is None:
            self._helper = self.node("test_helper")
        return self._helper

    def fail_on(self, failure_reason: Callable[[], str | None]) -> None:
        """Have `spin_until` fail as soon as `trouble` returns a text."""
        self._failure_checks.append(failure_reason)

    def close(self) -> None:
        """Destroy everything.

        Raises:
            LeakedNodesError: nodes were made in this context other than by this class, and not
                destroyed; they are destroyed now.
        """
        leaked = self._untracked_nodes()
        names = sorted(str(node.get_fully_qualified_name()) for node in leaked)
        self.executor.shutdown()
        for node in [*self._nodes, *leaked]:
            node.destroy_node()
        self._nodes.clear()
        rclpy.shutdown(context=self.context)
        if names:
            raise LeakedNodesError(
                f"the test left nodes: {', '.join(names)}; make them by ros.node or ros.add, or"
                " call their destroy_node()"
            )

    def _untracked_nodes(self) -> list[Node]:
        """Living nodes of this context that are not in our list."""
        gc.collect()
        known = {id(node) for node in self._nodes}
        return [
            found
            for found in gc.get_objects()
            if issubclass(type(found), Node) and id(found) not in known and self._is_alive(found)
        ]

    def _is_alive(self, node: Node) -> bool:
        # The first publisher of every node is dropped when the node is destroyed; one that
        # failed before it had any needs no destroying.
        made = getattr(node, "_parameter_event_publisher", None) is not None
        return made and node.context is self.context


def _text(condition: Callable[[], Any]) -> str:
    """Source of a condition: what its lambda says, where it is called."""
    try:
        return inspect.getsource(condition).strip()
    except (OSError, TypeError):
        return repr(condition)

"""Nodes, topics and services in the context and executor of one test."""

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
"""Default timeout of every wait [s], generous because the machine may be busy."""

_SPIN_TIMEOUT = 0.02  # s between evaluations of a condition

N = TypeVar("N", bound=Node)


class LeakedNodesError(AssertionError):
    """A test did not destroy nodes that it created in this context."""


class Ros:
    """ROS context and executor of one test.

    Callbacks run only while the test spins: in `spin_until`, `spin_for` and `call`.

    Attributes:
        domain: domain id.
        context: context, for nodes created without this class.
        executor: executor of all nodes created here.
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
        # Until `close`, the garbage collector, and the search for nodes that were not destroyed,
        # go through objects of this test only: of a million others they take 0.3 s.
        gc.freeze()

    def node(self, name: str = "test", **kwargs: Any) -> Node:
        """Create a plain node; `kwargs` are those of `rclpy.node.Node`."""
        return self.add(Node, name, **kwargs)

    def add(
        self,
        node_class: Callable[..., N],
        *args: Any,
        parameters: Mapping[str, Any] | None = None,
        **kwargs: Any,
    ) -> N:
        """Create a node in the context of the test and add it to the executor.

        Args:
            node_class: class that passes its keyword arguments to `rclpy.node.Node`, as all nodes
                of this package do.
            args, kwargs: arguments of the class and of `rclpy.node.Node`, such as `namespace`.
            parameters: parameter overrides by name.

        Raises:
            ParameterError: the node does not declare one of the parameters.
        """
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        try:
            node = node_class(*args, context=self.context, parameter_overrides=overrides, **kwargs)
            reject_unknown_overrides(node)
        except BaseException:
            # A failed constructor leaves a partly built node, which the traceback keeps alive.
            for untracked in self._untracked_nodes():
                untracked.destroy_node()
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
        """Spin until a condition holds.

        Args:
            condition: evaluated after every callback.
            timeout: wall clock time [s].
            what: description of the condition for the error message; its source by default.

        Raises:
            AssertionError: the condition did not hold in time, or a process of `ros_process` that
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
        """Spin for some seconds, to check that something does *not* happen."""
        end = time.monotonic() + seconds
        self.spin_until(lambda: time.monotonic() >= end, seconds + DEADLINE)

    def collect(self, topic: str, of: type, qos: QoSProfile = ROWS) -> list[Any]:
        """Return a list to which every received message of a topic is appended.

        Args:
            topic: name of the topic.
            of: message class.
            qos: profile of `msg_bridge.codec.qos`; TRANSIENT_LOCAL also gets the last message
                published before.
        """
        received: list[Any] = []
        self.helper.create_subscription(of, topic, received.append, qos)
        return received

    def publisher(
        self, topic: str, of: type, qos: QoSProfile = ROWS, *, subscriptions: int = 0
    ) -> Publisher:
        """Create a publisher and wait until it has matched `subscriptions` subscriptions."""
        publisher = self.helper.create_publisher(of, topic, qos)
        self.spin_until(
            lambda: publisher.get_subscription_count() >= subscriptions,
            what=f"{subscriptions} subscriptions to {topic}",
        )
        return publisher

    def call(self, of: type, name: str, request: Any, timeout: float = DEADLINE) -> Any:
        """Call a service and return its response.

        Args:
            of: service class, such as `std_srvs.srv.Trigger`.
            name: name of the service.
            request: request, such as `Trigger.Request()`.
            timeout: wall clock time [s] for discovery and again for the response.

        Raises:
            AssertionError: the service was not found or did not respond in time.
        """
        client = self.helper.create_client(of, name)
        try:
            self.spin_until(client.service_is_ready, timeout, f"the service {name}")
            future = client.call_async(request)
            self.spin_until(future.done, timeout, f"the response of {name}")
            return future.result()
        finally:
            self.helper.destroy_client(client)

    def node_names(self) -> list[str]:
        """Return the full names of all discovered nodes of the domain, sorted."""
        return sorted(self.helper.get_fully_qualified_node_names())

    @property
    def helper(self) -> Node:
        """Node of `collect`, `publisher` and `call`, created on first use."""
        if self._helper is None:
            self._helper = self.node("test_helper")
        return self._helper

    def fail_on(self, failure_reason: Callable[[], str | None]) -> None:
        """Make `spin_until` fail as soon as `failure_reason` returns a text."""
        self._failure_checks.append(failure_reason)

    def close(self) -> None:
        """Destroy all nodes and the context.

        Raises:
            LeakedNodesError: nodes were created in this context without this class and not
                destroyed; they are destroyed now.
        """
        leaked = self._untracked_nodes()
        names = sorted(str(node.get_fully_qualified_name()) for node in leaked)
        self.executor.shutdown()
        for node in [*self._nodes, *leaked]:
            node.destroy_node()
        self._nodes.clear()
        rclpy.shutdown(context=self.context)
        gc.unfreeze()
        if names:
            raise LeakedNodesError(
                f"the test did not destroy the nodes {', '.join(names)}; create them with"
                f" ros.node or"
                " ros.add, or call destroy_node()"
            )

    def _untracked_nodes(self) -> list[Node]:
        """Return the live nodes of this context that were created without this class."""
        gc.collect()
        known = {id(node) for node in self._nodes}
        return [
            found
            for found in gc.get_objects()
            if issubclass(type(found), Node) and id(found) not in known and self._is_alive(found)
        ]

    def _is_alive(self, node: Node) -> bool:
        # The first publisher of a node is dropped when the node is destroyed; a node that failed
        # before it had one needs no destruction.
        made = getattr(node, "_parameter_event_publisher", None) is not None
        return made and node.context is self.context


def _text(condition: Callable[[], Any]) -> str:
    """Return the source line of a condition."""
    try:
        return inspect.getsource(condition).strip()
    except (OSError, TypeError):
        return repr(condition)

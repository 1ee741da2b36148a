"""Node that serves all topics live to Foxglove and Lichtblick.

python -m msg_bridge.foxglove_server.node --ros-args -p port:=8766 -p exclude:=/soil/
"""

from __future__ import annotations

import queue
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.topic_endpoint_info import TopicEndpointInfo

from msg_bridge.bag.bundled_types import TF_TYPE
from msg_bridge.codec.stamps import clock_time_ns
from msg_bridge.contract import topics
from msg_bridge.contract.interface import holds_state
from msg_bridge.foxglove_server.client_messages import ClientMessageError, ClientMessages
from msg_bridge.foxglove_server.live_channels import LiveChannels
from msg_bridge.foxglove_server.params import FoxgloveServerParams
from msg_bridge.foxglove_server.sdk import FoxgloveServerError, load_sdk
from msg_bridge.foxglove_server.service_calls import ServiceCalls
from msg_bridge.foxglove_server.usage import USAGE
from msg_bridge.nodes.process_main import run_background_node
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.raw_topics.graph_topics import GraphTopics
from msg_bridge.raw_topics.raw_subscriptions import all_transient_local
from msg_bridge.raw_topics.tf_from_transforms import TfFromTransforms

__all__ = ["FoxgloveServerNode", "main"]

# Wall times [s].
_POLL_PERIOD = 0.02
_TF_REPEAT_PERIOD = 1.0  # of /tf while the simulation stands still

_MAX_QUEUED_MESSAGES = 2048
"""Messages that are queued for a slow client; then the oldest are dropped."""


class FoxgloveServerNode(SimNode):
    """Node `foxglove_server`.

    Its time is that of `clock` in its namespace: clients show simulation time.

    Attributes:
        port: port of the server.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Start the server and subscribe to the topics of the graph.

        Args:
            kwargs: of `rclpy.node.Node`.

        Raises:
            ParameterError: a parameter is not valid.
            FoxgloveServerError: foxglove-sdk is missing, or the port is in use.
        """
        super().__init__("foxglove_server", **kwargs)
        params = self._params = declare_parameters(self, FoxgloveServerParams)
        sdk = load_sdk()
        context = sdk.Context()
        self._tasks: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._wake = self.create_guard_condition(self._run_tasks)
        self._clock_topic = self.resolve_topic_name(topics.CLOCK)
        self._sim_time = 0  # ns
        self._channels = LiveChannels(sdk, context)
        self._graph_topics = GraphTopics(self, self, is_selected=self._is_received)
        self._tf = TfFromTransforms(self._graph_topics)
        self._moved_tf_topics: set[str] = set()  # since the last repetition
        self._client_messages = ClientMessages(self, lambda: self._graph_topics.known_topics)
        self._server = self._start_server(sdk, context)
        self.port: int = self._server.port
        self.create_timer(_POLL_PERIOD, self._poll)
        self.create_timer(params.scan_period, self._graph_topics.scan)
        self.create_timer(_TF_REPEAT_PERIOD, self._repeat_tf)
        self.get_logger().info(
            f"serving ws://{params.address}:{self.port}; open it in Foxglove or Lichtblick as a"
            " Foxglove WebSocket connection"
        )
        self._graph_topics.scan()

    def stop(self) -> None:
        """Disconnect the clients and stop the server; a second call does nothing."""
        self._channels.close()
        self._server.stop()

    def _start_server(self, sdk: Any, context: Any) -> Any:
        params, capability = self._params, sdk.Capability
        capabilities, services = [capability.Time], []
        if params.allow_commands:
            capabilities.append(capability.ClientPublish)
        if params.allow_services:
            capabilities.append(capability.Services)
            services = ServiceCalls(self, sdk, self._run_in_executor).services
        try:
            return sdk.start_server(
                name="earthmoving_sim",
                host=params.address,
                port=params.port,
                capabilities=capabilities,
                server_listener=self,
                supported_encodings=["cdr"],
                services=services,
                context=context,
                message_backlog_size=_MAX_QUEUED_MESSAGES,
            )
        except RuntimeError as error:
            raise FoxgloveServerError(
                f"the server cannot listen on {params.address}:{params.port} ({error}); choose"
                " another port, e.g. -p port:=8766"
            ) from error

    def _is_received(self, topic: str) -> bool:
        return topic == self._clock_topic or self._params.is_selected(topic)

    # Topics, as GraphTopics finds them.

    def add_topic(
        self, topic: str, type_name: str, publishers: Sequence[TopicEndpointInfo]
    ) -> None:
        """Add a channel for a topic, unless one has been made, or only its time is used."""
        if self._params.is_selected(topic) and topic not in self._channels.topics:
            self._channels.add(topic, type_name)

    def update_publishers(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Keep the newest message of each publisher of a state for clients that connect later."""
        if publishers and (all_transient_local(publishers) or holds_state(topic)):
            self._channels.keep_newest(topic, len(publishers))

    def before_resubscription(self) -> None:
        """Send the queued messages."""
        self._poll()

    def warn(self, text: str) -> None:
        """Log a warning."""
        self.get_logger().warning(text)

    # Messages to clients.

    def _poll(self) -> None:
        """Send all queued messages and the time."""
        messages = self._graph_topics.take()
        last_time = self._sim_time
        for message in messages:
            if message.topic == self._clock_topic:
                time = clock_time_ns(message.data)
                self._sim_time = self._sim_time if time is None else time
            if message.topic in self._channels.topics:
                self._channels.send(message, self._sim_time)
        for message in self._tf.convert(messages) if self._params.make_tf else ():
            if self._params.is_selected(message.topic):
                if message.topic not in self._channels.topics:
                    self._channels.add(message.topic, TF_TYPE)
                self._channels.send(message, self._sim_time)
                self._moved_tf_topics.add(message.topic)
        if self._sim_time != last_time:
            self._server.broadcast_time(self._sim_time)

    def _send_again(self, topic: str) -> None:
        self._server.broadcast_time(self._sim_time)
        self._channels.send_again(topic, self._sim_time)
        self._send_newest_tf(topic)

    def _send_newest_tf(self, topic: str) -> None:
        newest = self._tf.newest(topic)
        if newest is not None and topic in self._channels.topics:
            self._channels.send_bytes(topic, newest, self._sim_time)

    def _repeat_tf(self) -> None:
        """Send the newest transforms again where none came.

        Lichtblick replaces transforms by the joints of a robot description, all zero, when it loads
        one; the next message of `/tf` corrects that.
        """
        for topic in self._tf.topics - self._moved_tf_topics:
            self._send_newest_tf(topic)
        self._moved_tf_topics.clear()

    # Calls by the server, in its threads.

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the newest messages of a state to a client that has subscribed to it."""
        self._run_in_executor(partial(self._send_again, str(channel.topic)))

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing."""

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Note what a client will publish."""
        ids = (int(client.id), int(channel.id))
        names = (str(channel.topic), str(channel.encoding), str(channel.schema_name))
        self._run_in_executor(partial(self._client_messages.advertise, *ids, *names))

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Remove a channel of a client."""
        self._run_in_executor(
            partial(self._client_messages.unadvertise, int(client.id), client_channel_id)
        )

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Publish a message of a client."""
        self._run_in_executor(
            partial(self._publish_client_message, int(client.id), client_channel_id, data)
        )

    def _publish_client_message(self, client: int, channel: int, data: bytes) -> None:
        try:
            self._client_messages.publish(client, channel, data)
        except ClientMessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=1.0)

    def _run_in_executor(self, task: Callable[[], None]) -> None:
        """Run a function soon in the thread of the executor; may be called in any thread."""
        self._tasks.put(task)
        self._wake.trigger()

    def _run_tasks(self) -> None:
        while True:
            try:
                task = self._tasks.get_nowait()
            except queue.Empty:
                return
            task()


def main(args: Sequence[str] | None = None) -> int:
    """Run the server as a process until SIGINT or SIGTERM.

    Args:
        args: command line with the program name first; by default `sys.argv`.

    Returns:
        The exit code: 0, or 2 with a message on stderr.
    """
    return run_background_node(FoxgloveServerNode, args, name="foxglove_server", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())

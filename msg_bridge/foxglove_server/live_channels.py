"""Channels of the server, one per topic, and the newest messages of topics that hold a state."""

from __future__ import annotations

from typing import Any

from msg_bridge.bag.message_schemas import schema_text
from msg_bridge.raw_topics.received_message import ReceivedMessage, TransientLocalHistory

__all__ = ["LiveChannels"]


class LiveChannels:
    """The channels that clients may subscribe to.

    The server has no transient-local topics: a client receives what is sent after it subscribed. So
    the newest messages of states are kept, and sent again for each new subscription. Clients that
    were subscribed before receive them twice.
    """

    def __init__(self, sdk: Any, context: Any) -> None:
        """
        Args:
            sdk: the module `foxglove`.
            context: its context, to which the server belongs.
        """
        self._sdk = sdk
        self._context = context
        self._channels: dict[str, Any] = {}
        self._schemas: dict[str, Any] = {}
        self._histories: dict[str, TransientLocalHistory] = {}

    @property
    def topics(self) -> list[str]:
        """Names of the topics that have a channel."""
        return list(self._channels)

    def add(self, topic: str, type_name: str) -> None:
        """Add a channel and advertise it to all clients.

        Args:
            topic: its name.
            type_name: as `std_msgs/msg/String`.

        Raises:
            SchemaError: the type is not installed.
        """
        if type_name not in self._schemas:
            self._schemas[type_name] = self._sdk.Schema(
                name=type_name, encoding="ros2msg", data=schema_text(type_name).encode()
            )
        self._channels[topic] = self._sdk.Channel(
            topic, schema=self._schemas[type_name], message_encoding="cdr", context=self._context
        )

    def keep_newest(self, topic: str, num_messages: int) -> None:
        """Keep the newest messages of a topic for clients that subscribe later.

        Args:
            topic: its name.
            num_messages: number of messages to keep, at least one.
        """
        self._histories.setdefault(topic, TransientLocalHistory(topic)).set_depth(num_messages)

    def send(self, message: ReceivedMessage, log_time: int) -> None:
        """Send a message to all clients that are subscribed to its topic.

        Args:
            message: a message of a topic with a channel.
            log_time: simulation time [ns].
        """
        self.send_bytes(message.topic, message.data, log_time)
        history = self._histories.get(message.topic)
        if history is not None:
            history.messages.append(message)

    def send_bytes(self, topic: str, data: bytes, log_time: int) -> None:
        """Send a serialised message that is not kept."""
        channel = self._channels[topic]
        if channel.has_sinks():
            channel.log(data, log_time=log_time)

    def send_again(self, topic: str, log_time: int) -> None:
        """Send the kept messages of a topic, if there are any."""
        history = self._histories.get(topic)
        for message in history.messages if history is not None else ():
            self.send_bytes(topic, message.data, log_time)

    def close(self) -> None:
        """Close all channels."""
        for channel in self._channels.values():
            channel.close()
        self._channels.clear()

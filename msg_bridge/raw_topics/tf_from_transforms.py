"""Make `/tf` from the transforms of the machines where no node publishes it.

The package tf2_msgs is not on PyPI, so machines whose ROS is installed from wheels publish only
geometry_msgs/TransformStamped on `<m>/transforms`. Viewers and tf2 expect tf2_msgs/TFMessage.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.codec.tf_message import SerializedTransform, read_transform, tf_message_to_cdr
from msg_bridge.contract import topics
from msg_bridge.contract.topics import resolve, simulation_namespace_of_machine
from msg_bridge.raw_topics.graph_topics import GraphTopics
from msg_bridge.raw_topics.received_message import ReceivedMessage

__all__ = ["TF_QOS", "TfFromTransforms"]

_TRANSFORM_TYPE = "geometry_msgs/msg/TransformStamped"

TF_QOS = OfferedQos(reliability="reliable", durability="volatile", history="keep_last", depth=100)
"""QoS of `/tf` as tf2 offers it, for players."""


class TfFromTransforms:
    """Converts messages on `<m>/transforms` to messages on the `tf` of their simulation."""

    def __init__(self, graph_topics: GraphTopics) -> None:
        """
        Args:
            graph_topics: the subscribed topics. A `tf` among them is not made.
        """
        self._graph_topics = graph_topics
        self._tf_topics: dict[str, str] = {}  # by topic of transforms
        self._num_made: dict[str, int] = {}  # by tf topic
        self._newest: dict[str, dict[bytes, SerializedTransform]] = {}  # by tf topic and frames

    def convert(self, messages: Sequence[ReceivedMessage]) -> list[ReceivedMessage]:
        """Return TFMessages made from received messages.

        Transforms of one topic and stamp that follow each other become one message. It has the
        times of the last of them.

        Args:
            messages: received messages of any topic, in their order.
        """
        made: list[ReceivedMessage] = []
        transforms = [
            (tf_topic, parsed, message)
            for message in messages
            if (tf_topic := self._tf_topic(message.topic))
            and (parsed := read_transform(message.data))
        ]
        for (tf_topic, _, _), group in groupby(
            transforms, lambda each: (each[0], each[2].topic, each[1].stamp)
        ):
            entries = list(group)
            made.append(self._make(tf_topic, [each[1] for each in entries], entries[-1][2]))
        return made

    @property
    def topics(self) -> set[str]:
        """Names of the topics that were made."""
        return set(self._newest)

    def newest(self, tf_topic: str) -> bytes | None:
        """Return a TFMessage with the newest transform of each frame; None if none was made."""
        newest = self._newest.get(tf_topic)
        return None if newest is None else tf_message_to_cdr(list(newest.values()))

    def _make(
        self, tf_topic: str, transforms: list[SerializedTransform], last: ReceivedMessage
    ) -> ReceivedMessage:
        number = self._num_made[tf_topic] = self._num_made.get(tf_topic, 0) + 1
        newest = self._newest.setdefault(tf_topic, {})
        newest.update((each.frames, each) for each in transforms)
        data = tf_message_to_cdr(transforms)
        return ReceivedMessage(tf_topic, data, last.received_time, last.source_time, number)

    def _tf_topic(self, topic: str) -> str | None:
        """Return the topic to make from a topic; None for other topics, and if it is received."""
        if topic.rpartition("/")[2] != topics.TRANSFORMS:
            return None
        tf_topic = self._tf_topics.get(topic)
        if tf_topic is None:
            if self._graph_topics.type_name(topic) != _TRANSFORM_TYPE:
                return None
            # The machine's other topics are known by now: it publishes transforms last.
            known = self._graph_topics.known_topics
            tf_topic = resolve(topics.TF, simulation_namespace_of_machine(topic, known))
            self._tf_topics[topic] = tf_topic
        return None if tf_topic in self._graph_topics.topics else tf_topic

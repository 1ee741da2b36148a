"""EndpointMonitor: reports endpoints of other nodes that disturb a node, once a second.

- A second publisher of a topic that only one executable publishes: two simulations mix, or a forged
  stream.
- A publisher of rows that is no machine node.
- A publisher whose QoS or type keeps its messages from a subscription of this node. The nodes run
  without QoS events, see `sim_node`.

The numbers of discovered and of matched publishers are compared first, which is cheap; the details
of the publishers are queried only where these numbers are not as expected.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from msg_bridge.contract import topics
from msg_bridge.contract.interface import is_exclusive
from msg_bridge.nodes.diagnostics import Diagnostics, Level

__all__ = ["UNKNOWN_NODE", "EndpointMonitor", "node_name"]

_ROW_TOPICS = (topics.SOIL_TOOL_SWEEPS, topics.SOIL_DEPOSIT_REQUESTS)
"""Topics that all machine nodes publish, and nothing else may."""

_MAX_TOPICS_IN_TEXT = 4
_CONDITION = "endpoints of other nodes"

_ANOTHER = "give each node its own namespace, or each simulation its own ROS_DOMAIN_ID"

_RESTARTED = f"if one was killed, its DDS lease ends in 10 s; else {_ANOTHER}"

_UNKNOWN_PART = "UNKNOWN"
"""Part of the name that rmw gives a node of which it has only the endpoints."""

UNKNOWN_NODE = "a node of unknown name"
"""Name of such a node in texts: it has just started, or was killed."""

_Endpoint = tuple[str, tuple[int, ...]]
"""Topic and id of a publisher; one that was restarted has another id."""

Findings = dict[tuple[Level, str, str], set[_Endpoint]]
"""Publishers by level, what is wrong (with `{}` for the topics), and what to change."""


class EndpointMonitor:
    """Checks the publishers of all topics of a node, with log and diagnostics."""

    def __init__(self, node: Node, diagnostics: Diagnostics) -> None:
        """
        Args:
            node: the node, which has all its publishers and subscriptions.
            diagnostics: its diagnostics.
        """
        self._node, self._diagnostics = node, diagnostics
        self._own_name = str(node.get_fully_qualified_name())
        self._found: Findings = {}  # by the last update
        self._reported: Findings = {}
        diagnostics.add_task(self.update)

    def update(self) -> None:
        """Check all topics, and report what has changed: also a publisher that was restarted."""
        subscriptions: defaultdict[str, list[Subscription]] = defaultdict(list)
        for subscription in self._node.subscriptions:
            subscriptions[subscription.topic_name].append(subscription)
        published = {publisher.topic_name for publisher in self._node.publishers}
        findings: Findings = defaultdict(set)
        for topic in {*published, *subscriptions}:
            count = self._node.count_publishers(topic)
            if count > 1 and is_exclusive(topic):
                self._check_exclusive(topic, findings, is_own=topic in published)
            own = subscriptions.get(topic, [])
            if own and max(each.get_publisher_count() for each in own) < count:
                self._check_compatible(topic, own, findings)
        self._check_row_publishers(subscriptions, findings)
        # What is found once may be a node of which only a part is discovered yet.
        before, self._found = self._found, dict(findings)
        confirmed = {key: found & before.get(key, set()) for key, found in findings.items()}
        self._report({key: found for key, found in confirmed.items() if found})

    def _publishers(self, topic: str) -> list[TopicEndpointInfo]:
        """Return the publishers of a topic, always in the same order."""
        infos = self._node.get_publishers_info_by_topic(topic)
        return sorted(infos, key=lambda info: tuple(info.endpoint_gid))

    def _check_exclusive(self, topic: str, findings: Findings, *, is_own: bool) -> None:
        """Find the nodes that publish a topic which only one may publish."""
        publishers = self._publishers(topic)
        if not is_own:
            if len(publishers) > 1:
                names = sorted(map(node_name, publishers))
                what = f"nodes {' and '.join(names)} both publish {{}}, which one may"
                is_known = len(set(names)) == len(names) and UNKNOWN_NODE not in names
                remedy = _ANOTHER if is_known else _RESTARTED
                findings[Level.WARN, what, remedy].update(_endpoint(topic, e) for e in publishers)
            return
        own = next((each for each in publishers if node_name(each) == self._own_name), None)
        for publisher in publishers:
            if publisher is not own:
                what = f"another node, {node_name(publisher)}, also publishes {{}} of this node"
                remedy = _RESTARTED if node_name(publisher) == UNKNOWN_NODE else _ANOTHER
                findings[Level.ERROR, what, remedy].add(_endpoint(topic, publisher))

    def _check_compatible(
        self, topic: str, subscriptions: Iterable[Subscription], findings: Findings
    ) -> None:
        """Find the publishers that none of the subscriptions to a topic receives."""
        for publisher in self._publishers(topic):
            reasons = [_incompatibility(publisher, each) for each in subscriptions]
            if all(reasons):
                what = f"messages of {node_name(publisher)} on {{}} are not received ({reasons[0]})"
                findings[Level.WARN, what, "change the publisher"].add(_endpoint(topic, publisher))

    def _check_row_publishers(
        self, subscriptions: dict[str, list[Subscription]], findings: Findings
    ) -> None:
        """Find the publishers of rows that are not machine nodes."""
        rows = [topic for topic in subscriptions if topic.endswith(_ROW_TOPICS)]
        if not rows:
            return
        headers = [topic for topic in subscriptions if topic.endswith(f"/{topics.MACHINE_TICK}")]
        machines = sum(self._node.count_publishers(topic) for topic in headers)
        if all(self._node.count_publishers(topic) == machines for topic in rows):
            return
        names = {node_name(each) for topic in headers for each in self._publishers(topic)}
        for topic in rows:
            for publisher in self._publishers(topic):
                if node_name(publisher) not in names:
                    what = (
                        f"{node_name(publisher)}, which is no machine node of this simulation,"
                        " publishes {}"
                    )
                    findings[Level.WARN, what, "stop it"].add(_endpoint(topic, publisher))

    def _report(self, findings: Findings) -> None:
        logger = self._node.get_logger()
        for key, found in findings.items():
            level, what, remedy = key
            new = found - self._reported.get(key, set())
            if new:
                text = f"{what.format(_list(new))}; {remedy}"
                if level is Level.ERROR:
                    logger.error(text)
                else:
                    logger.warning(text)
        for _, what, _ in set(self._reported) - set(findings):
            logger.info(f"no longer: {what.format('topics')}")
        self._reported = dict(findings)
        if findings:
            texts = [f"{what.format(_list(t))}; {fix}" for (_, what, fix), t in findings.items()]
            level = max(level for level, _, _ in findings)
            self._diagnostics.problem("; ".join(sorted(texts)), level, condition=_CONDITION)
        else:
            self._diagnostics.clear(_CONDITION)


def _endpoint(topic: str, info: TopicEndpointInfo) -> _Endpoint:
    return topic, tuple(info.endpoint_gid)


def node_name(info: TopicEndpointInfo) -> str:
    """Return the full name of the node of an endpoint, or that it is unknown."""
    if _UNKNOWN_PART in info.node_name:
        return UNKNOWN_NODE
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _incompatibility(publisher: TopicEndpointInfo, subscription: Subscription) -> str:
    """Return why a subscription does not receive a publisher; empty if it does."""
    kind = subscription.msg_type
    own_type = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
    if publisher.topic_type != own_type:
        return f"its type is {publisher.topic_type}, not {own_type}"
    compatibility, reason = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
    if compatibility != QoSCompatibility.ERROR:  # not an enum of Python
        return ""
    return f"QoS: {reason.removeprefix('ERROR: ').rstrip('; ').lower()}"


def _list(endpoints: set[_Endpoint]) -> str:
    """Return some of the topics, and the number of the others."""
    names = sorted({topic for topic, _ in endpoints})
    first = names[:_MAX_TOPICS_IN_TEXT]
    rest = len(names) - len(first)
    return ", ".join(first) + (f" and {rest} more topics" if rest else "")

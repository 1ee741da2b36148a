"""Endpoint: a topic or service of the interface."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["Endpoint", "EndpointKind", "Scope"]


class Scope(str, Enum):
    """Namespace that a name is relative to; see `msg_bridge.contract.topics`."""

    SIMULATION = "simulation"
    MACHINE_NODE = "machine node"
    MACHINE = "machine"


class EndpointKind(str, Enum):
    """How an endpoint is used."""

    TOPIC = "topic"
    SERVICE = "service"


@dataclass(frozen=True)
class Endpoint:
    """A topic or service.

    Attributes:
        name: relative to the namespace of its scope; a part in angle brackets stands for a name
            from the machine file or a parameter.
        type: ROS type, `package/msg/Type`.
        scope: namespace that the name is relative to.
        publishers: executables that publish the topic, or serve the service.
        subscribers: executables of this package that subscribe to it.
        qos: name of a profile in `msg_bridge.codec.qos`; empty for a service.
        rate: when it is published, in simulated time.
        description: contents, with units and frame.
        condition: when the endpoint exists; empty: always.
        kind: topic or service.
    """

    name: str
    type: str
    scope: Scope
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    qos: str
    rate: str
    description: str
    condition: str = ""
    kind: EndpointKind = EndpointKind.TOPIC

    @property
    def full_name(self) -> str:
        """Name with a placeholder for its namespace, as in help texts and documents."""
        placeholder = {Scope.SIMULATION: "/", Scope.MACHINE_NODE: "<n>/", Scope.MACHINE: "<m>/"}
        return placeholder[self.scope] + self.name

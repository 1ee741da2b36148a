"""Parameters of the Foxglove server: what is served, where, and what clients may do."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.loopback import is_loopback
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.raw_topics.topic_selection import is_topic_selected, validate_expression

__all__ = ["FoxgloveServerParams"]


@dataclass(frozen=True)
class FoxgloveServerParams(Parameters):
    """Parameters of `foxglove_server`."""

    address: str = parameter(
        "127.0.0.1",
        "address to listen on; clients give no token, so with any other than the loopback address"
        " every computer that reaches it sees all topics",
    )
    port: int = parameter(8765, "port to listen on; 0: any that is free", low=0, high=65535)
    include: str = parameter(
        "", "regular expression: serve only topics whose names match; by default all"
    )
    exclude: str = parameter(
        "", "regular expression: do not serve topics whose names match; by default none"
    )
    make_tf: bool = parameter(
        True,
        "serve /tf made from <m>/transforms where no node publishes it, as without tf2_msgs",
    )
    allow_commands: bool = parameter(
        False,
        "whether clients may publish joy, joint_commands, cmd_vel and emergency_stop of machines;"
        " only with a loopback address",
    )
    allow_services: bool = parameter(
        False,
        "whether clients may call the services of the simulation; only with a loopback address",
    )
    scan_period: float = parameter(
        0.1, "wall time between searches for new topics", unit="s", low=0.01, high=10.0
    )
    niceness: int = parameter(
        10, "niceness of the process, so that serving delays no tick", low=0, high=19
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_expression("include", self.include)
        validate_expression("exclude", self.exclude)
        if (self.allow_commands or self.allow_services) and not is_loopback(self.address):
            raise ParameterError(
                f"address is {self.address!r}, and clients give no token: with allow_commands or"
                " allow_services use 127.0.0.1, and from another computer a tunnel (ssh -L"
                f" {self.port}:127.0.0.1:{self.port} HOST)"
            )

    def is_selected(self, topic: str) -> bool:
        """Return whether a topic is served."""
        return is_topic_selected(topic, self.include, self.exclude)

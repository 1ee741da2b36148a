"""Parameters of a machine's node: which machines, where, and how often it tells their state."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, fields

from machine_sim.simulated_bin import BinSpec
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["BinParams", "MachineInstanceParams", "MachineNodeParams"]

_GROUPS = ("stepping", "particles", "sensors", "commands")
"""Groups of the node's own parameters, after which no machine can be named."""

_NAME = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*_?")
"""What may be a part of a topic's name."""


@dataclass(frozen=True)
class MachineInstanceParams(Parameters):
    """What is said of each machine of a node by itself."""

    machine: str = parameter(
        "machines/excavator.yaml", "machine file: a path, or the name of a shipped one"
    )
    x: float = parameter(0.0, "where it is set down, map x", unit="m", low=-1e5, high=1e5)
    y: float = parameter(0.0, "where it is set down, map y", unit="m", low=-1e5, high=1e5)
    yaw: float = parameter(
        0.0, "where it faces, from +x counter-clockwise", unit="deg", low=-360.0, high=360.0
    )
    frame_prefix: str = parameter(
        "",
        "put before the names of its frames; empty: a slash after its name among `machines`, or"
        " after the node's namespace where it is the only one",
    )
    command_wait_period: int = parameter(
        0,
        "in lockstep, wait at every so many ticks for a joint_commands or cmd_vel message stamped"
        " with the time reached, so that controller and simulation take turns; 0: never wait",
        low=0, high=10_000,
    )  # fmt: skip
    command_delay: int = parameter(
        0,
        "in lockstep, ticks from the time a joint_commands or cmd_vel message is stamped with until"
        " it counts; with command_wait_period, the machine goes on for that long while the"
        " controller thinks, and the run repeats all the same",
        low=0, high=1000,
    )  # fmt: skip


@dataclass(frozen=True)
class BinParams(Parameters):
    """What is said of each bin."""

    x: float = parameter(0.0, "where its middle stands, map x", unit="m", low=-1e5, high=1e5)
    y: float = parameter(0.0, "where its middle stands, map y", unit="m", low=-1e5, high=1e5)
    yaw: float = parameter(
        0.0,
        "where its length points, from +x counter-clockwise",
        unit="deg",
        low=-360.0,
        high=360.0,
    )
    length: float = parameter(4.0, "inside", unit="m", low=0.2, high=50.0)
    width: float = parameter(2.4, "inside", unit="m", low=0.2, high=50.0)
    height: float = parameter(1.5, "inside", unit="m", low=0.1, high=20.0)

    @property
    def spec(self) -> BinSpec:
        """The bin, and where it stands."""
        place = ((self.x, self.y), math.radians(self.yaw))
        return BinSpec(*place, self.length, self.width, self.height)


@dataclass(frozen=True)
class MachineNodeParams(MachineInstanceParams):
    """What a machine's node simulates and publishes.

    The node's namespace names its only machine, of which the inherited parameters speak. Those
    named in `machines` have a group of them each, and topics in a namespace of their own below it.
    """

    machines: tuple[str, ...] = parameter(
        (),
        "names of its machines, if there are several; of each, <name>.machine, <name>.x and so on"
        " are given, and not machine, x and so on",
        items=str,
    )
    bins: tuple[str, ...] = parameter(
        (),
        "names of boxes that stand there to be filled; of each, <name>.x, <name>.y, <name>.yaw and"
        " its <name>.length, <name>.width and <name>.height are given",
        items=str,
    )
    machine_id: int = parameter(
        1, "number of this node in the exchange, no other node's", low=1, high=65535
    )
    seed: int = parameter(0, "of the scatter of released soil", low=0, high=2**31)
    required_subscribers: tuple[str, ...] = parameter(
        (),
        "names of nodes that must be subscribed to every topic before it joins, such as recorder",
        items=str,
    )
    state_rate: float = parameter(
        50.0, "joint_states, odom, payload, wrench", unit="Hz of simulated time",
        low=0.1, high=1000.0,
    )  # fmt: skip
    particle_rate: float = parameter(
        20.0, "particles", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    transform_rate: float = parameter(
        20.0, "transforms and /tf", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    marker_rate: float = parameter(
        10.0, "markers", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    hash_rate: float = parameter(
        1.0, "state_hash", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    publish_tf: bool = parameter(
        True, "publish /tf (where tf2_msgs is installed): one publisher of a machine's frames"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        taken = {*_GROUPS, *(each.name for each in fields(self))}
        for name, times in Counter([*self.machines, *self.bins]).items():
            where = " and ".join(
                each for each in ("machines", "bins") if name in getattr(self, each)
            )
            if times > 1:
                raise ParameterError(
                    f"{where} name {name!r} {times} times; name each machine and each bin once"
                )
            if not _NAME.fullmatch(name) or name in taken:
                raise ParameterError(
                    f"{where} name {name!r}, which cannot be the name of one; give letters, digits"
                    " and single underscores, a letter first, and nothing that is a parameter of"
                    f" the node or a group of them ({', '.join(_GROUPS)})"
                )
        of_one = [
            each
            for each in fields(MachineInstanceParams)
            if getattr(self, each.name) != each.default
        ]
        if self.machines and of_one:
            given = of_one[0].name
            raise ParameterError(
                f"{given} is given, and machines too; give it to each machine, as"
                f" {self.machines[0]}.{given}, or leave machines empty"
            )

"""Parameters of a machine node: machines, initial poses, and rates of publications."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, fields
from typing import Literal

from machine_sim.simulated_bin import BinSpec
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["BinParams", "MachineInstanceParams", "MachineNodeParams"]

_GROUPS = ("stepping", "particles", "sensors", "commands")
"""Parameter groups of the node; no machine can have their names."""

_NAME = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*_?")
"""Pattern of a valid part of a topic name."""


@dataclass(frozen=True)
class MachineInstanceParams(Parameters):
    """Parameters of each machine of a node."""

    machine: str = parameter(
        "machines/excavator.yaml", "machine file: a path, or the name of a shipped file"
    )
    x: float = parameter(0.0, "initial position, map x", unit="m", low=-1e5, high=1e5)
    y: float = parameter(0.0, "initial position, map y", unit="m", low=-1e5, high=1e5)
    yaw: float = parameter(
        0.0, "initial heading, from +x counter-clockwise", unit="deg", low=-360.0, high=360.0
    )
    frame_prefix: str = parameter(
        "",
        "prefix of its frames; empty: its name in `machines`, or the node's namespace for the only"
        " machine, and a slash",
    )
    command_wait_period: int = parameter(
        0,
        "in lockstep, period in ticks at which the simulation waits for a joint_commands or cmd_vel"
        " message stamped with the present simulation time; 0: never wait",
        low=0, high=10_000,
    )  # fmt: skip
    command_delay: int = parameter(
        0,
        "in lockstep, number of ticks from the stamp of a joint_commands or cmd_vel message until"
        " it takes effect; with command_wait_period, the simulation continues for that long while"
        " the controller computes, and the run stays reproducible",
        low=0, high=1000,
    )  # fmt: skip


@dataclass(frozen=True)
class BinParams(Parameters):
    """Parameters of each bin."""

    x: float = parameter(0.0, "position of its centre, map x", unit="m", low=-1e5, high=1e5)
    y: float = parameter(0.0, "position of its centre, map y", unit="m", low=-1e5, high=1e5)
    yaw: float = parameter(
        0.0,
        "direction of its length, from +x counter-clockwise",
        unit="deg",
        low=-360.0,
        high=360.0,
    )
    length: float = parameter(4.0, "inside length", unit="m", low=0.2, high=50.0)
    width: float = parameter(2.4, "inside width", unit="m", low=0.2, high=50.0)
    height: float = parameter(1.5, "inside height", unit="m", low=0.1, high=20.0)

    @property
    def spec(self) -> BinSpec:
        """Pose and size of the bin."""
        pose = ((self.x, self.y), math.radians(self.yaw))
        return BinSpec(*pose, self.length, self.width, self.height)


@dataclass(frozen=True)
class MachineNodeParams(MachineInstanceParams):
    """Parameters of a machine node.

    The inherited parameters are those of the node's only machine, which the node's namespace names.
    Each machine in `machines` has its own group of them, and its own namespace below the node's.
    """

    machines: tuple[str, ...] = parameter(
        (),
        "names of the machines, if there are several; each has parameters <name>.machine, <name>.x"
        " and so on instead of machine, x and so on",
        items=str,
    )
    bins: tuple[str, ...] = parameter(
        (),
        "names of bins; each has parameters <name>.x, <name>.y, <name>.yaw, <name>.length,"
        " <name>.width and <name>.height",
        items=str,
    )
    machine_id: int = parameter(
        1, "id of this node in the exchange, unique among nodes", low=1, high=65535
    )
    exchange_key_file: str = parameter(
        "",
        "file with a secret key that soil and machine nodes share; they authenticate the messages"
        " of the exchange with it and reject others; empty: no authentication",
    )
    seed: int = parameter(0, "seed of released soil and sensor errors", low=0, high=2**31)
    required_subscribers: tuple[str, ...] = parameter(
        (),
        "names of nodes, such as exchange_recorder, that must subscribe to every topic before this"
        " node joins",
        items=str,
    )
    state_rate: float = parameter(
        50.0, "rate of joint_states, odom, payload, wrench, cylinders", unit="Hz of simulated time",
        low=0.1, high=1000.0,
    )  # fmt: skip
    particle_rate: float = parameter(
        20.0, "rate of particles", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    transform_rate: float = parameter(
        20.0, "rate of transforms and tf", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    marker_rate: float = parameter(
        10.0, "rate of markers", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    hash_rate: float = parameter(
        1.0, "rate of state_hash", unit="Hz of simulated time", low=0.0, high=1000.0
    )
    publish_tf: bool = parameter(
        True,
        "publish tf, where tf2_msgs is installed; only one node may publish a machine's frames",
    )
    description_meshes: Literal["embedded", "primitives"] = parameter(
        "embedded",
        "shapes in robot_description; embedded: meshes as data URIs in it; primitives: boxes and"
        " cylinders, for RViz, which cannot read data URIs",
        choices=("embedded", "primitives"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        reserved = {*_GROUPS, *(each.name for each in fields(self))}
        for name, count in Counter([*self.machines, *self.bins]).items():
            where = " and ".join(
                each for each in ("machines", "bins") if name in getattr(self, each)
            )
            if count > 1:
                raise ParameterError(
                    f"{where} name {name!r} {count} times; name each machine and each bin once"
                )
            if not _NAME.fullmatch(name) or name in reserved:
                raise ParameterError(
                    f"{where} contain {name!r}, which is not a valid name; give letters, digits and"
                    " single underscores, a letter first, and no name of a parameter of the node or"
                    f" of a group ({', '.join(_GROUPS)})"
                )
        of_only_machine = [
            each
            for each in fields(MachineInstanceParams)
            if getattr(self, each.name) != each.default
        ]
        if self.machines and of_only_machine:
            name = of_only_machine[0].name
            raise ParameterError(
                f"{name} and machines are both set; set {self.machines[0]}.{name} for each machine,"
                " or leave machines empty"
            )

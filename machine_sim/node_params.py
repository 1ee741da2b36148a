"""Parameters of a machine's node: which machine, where, and how often it tells its state."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["MachineNodeParams"]


@dataclass(frozen=True)
class MachineNodeParams(Parameters):
    """What a machine's node simulates and publishes; the node's namespace names the machine."""

    source: int = parameter(
        1, "number of this machine in the exchange, no other machine's", low=1, high=65535
    )
    machine: str = parameter(
        "machines/excavator.yaml", "machine file: a path, or the name of a shipped one"
    )
    x: float = parameter(0.0, "where it is set down, map x", unit="m", low=-1e5, high=1e5)
    y: float = parameter(0.0, "where it is set down, map y", unit="m", low=-1e5, high=1e5)
    yaw: float = parameter(
        0.0, "where it faces, from +x counter-clockwise", unit="deg", low=-360.0, high=360.0
    )
    seed: int = parameter(0, "of the scatter of released soil", low=0, high=2**31)
    frame_prefix: str = parameter(
        "", "put before the names of its frames; empty: its namespace and a slash"
    )
    await_commands_every: int = parameter(
        0,
        "in lockstep, wait at every so many ticks for a joint_commands or cmd_vel message stamped"
        " with the time reached, so that controller and simulation take turns; 0: never wait",
        low=0, high=10_000,
    )  # fmt: skip
    command_delay: int = parameter(
        0,
        "in lockstep, ticks from the time a joint_commands or cmd_vel message is stamped with until"
        " it counts; with await_commands_every, the machine goes on for that long while the"
        " controller thinks, and the run repeats all the same",
        low=0, high=1000,
    )  # fmt: skip
    await_listeners: tuple[str, ...] = parameter(
        (),
        "names of nodes that must be subscribed to every topic before it joins, such as recorder",
        items=str,
    )
    state_rate: float = parameter(
        50.0, "joint_states, odom, payload, wrench", unit="1/s of simulated time",
        low=0.1, high=1000.0,
    )  # fmt: skip
    particle_rate: float = parameter(
        20.0, "particles", unit="1/s of simulated time", low=0.0, high=1000.0
    )
    transform_rate: float = parameter(
        20.0, "transforms and /tf", unit="1/s of simulated time", low=0.0, high=1000.0
    )
    marker_rate: float = parameter(
        10.0, "markers", unit="1/s of simulated time", low=0.0, high=1000.0
    )
    hash_rate: float = parameter(
        1.0, "state_hash", unit="1/s of simulated time", low=0.0, high=1000.0
    )
    publish_tf: bool = parameter(
        True, "publish /tf (where tf2_msgs is installed): one publisher of a machine's frames"
    )

"""Contents of `machine_sim --help`."""

from __future__ import annotations

from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams
from machine_sim.node.params import BinParams, MachineInstanceParams, MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.sensors import SensorParams
from msg_bridge.nodes.node_usage import NodeUsage

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Simulate one or several machines, their tools and the excavated soil as particles. The node's"
    " namespace (-r __ns:=/excavator) names its only machine; relative topics lie in it, or in"
    " <namespace>/<machine> with several machines.",
    parameters={
        "": MachineNodeParams,
        "<machine>.": MachineInstanceParams,
        "<bin>.": BinParams,
        "stepping.": MachineSimParams,
        "particles.": ParticleParams,
        "sensors.": SensorParams,
        "commands.": CommandParams,
    },
    subscriptions={
        "front_velocity_controller/commands": "joint velocities in the order of the machine file"
        " [rad/s]",
        "track_velocity_controller/commands": "track velocities left, right [m/s]",
        "joint_commands": "velocities or positions of named joints and tracks",
        "cmd_vel": "velocity of the base, split onto the tracks",
        "joy": "joystick of an ISO or SAE cab",
        "emergency_stop": "true stops the machine until false",
        "/sim/config": "parameters of the run",
        "/terrain/map": "terrain at the start of a run and after a rejoin",
        "/terrain/map_updates, /soil/conversions, /soil/forces": "answers of the soil to a tick",
        "/soil/tick, /soil/join_rejections, conversion_backlog": "headers of the exchange,"
        " rejections, rows after a rejoin",
    },
    publications={
        "joint_states, odom, payload, <tool>/wrench, cylinders": "state of the machine",
        "imu/<name>/data, joint_states_measured": "sensors with their errors",
        "applied_commands": "command that takes effect in each tick",
        "transforms, /tf, markers, robot_description": "poses and visuals of the links",
        "particles, <bin>/payload": "excavated soil",
        "config, state_hash, /diagnostics": "parameters, hash of the state, condition of the node",
        "soil_tick, /soil/tool_sweeps, /soil/deposit_requests": "the exchange with the soil",
    },
)

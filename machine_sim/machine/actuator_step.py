"""One step of all actuators of a machine: from commands to the targets of the joint motors.

valves -> speeds that the pumps can supply -> engine -> joint references -> torque limits
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.hydraulic_kernels import advance_supply, limit_speeds, limit_torques
from machine_sim.machine.joint_reference import advance_references
from machine_sim.machine.joint_table import COMMAND
from machine_sim.machine.valves import DEMAND, advance_valves
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = ["ActuatorTables", "actuator_step", "advance_actuators"]

Array = NDArray[np.float64]


class ActuatorTables(NamedTuple):
    """Parameters and state of the actuators of a machine.

    Attributes:
        valves: `Valves.table`, joints first, then left and right track.
        joints: table of the joints with their present motion; targets and limits are updated.
        cylinders, motors, supply: tables of the hydraulics.
        track_forces: drive forces of both tracks in the last step [N], shape (2,).
        track_speeds: out, belt speeds that the tracks are commanded to [m/s], shape (2,).
    """

    valves: Array
    joints: Array
    cylinders: Array
    motors: Array
    supply: Array
    track_forces: Array
    track_speeds: Array


@fixed_signature_kernel
def actuator_step(dt, boxed):  # type: ignore[no-untyped-def]
    """Run `advance_actuators` alone, with boxed tables."""
    advance_actuators(dt, boxed.table)


@helper(allocates=True)
def advance_actuators(dt, actuators):  # type: ignore[no-untyped-def]
    """Advance the actuators by a time step.

    Args:
        dt: time step [s].
        actuators: `ActuatorTables`.
    """
    joints, supply = actuators.joints, actuators.supply
    cylinders, motors = actuators.cylinders, actuators.motors
    advance_valves(dt, actuators.valves)
    limit_speeds(
        actuators.valves[DEMAND],
        joints,
        cylinders,
        motors,
        supply,
        joints[COMMAND],
        actuators.track_speeds,
    )
    advance_supply(dt, actuators.track_forces, supply)
    advance_references(dt, joints)
    limit_torques(dt, joints, cylinders, motors, supply)

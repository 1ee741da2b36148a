"""One step of all actuators of a machine: from commands to the targets of the joint motors.

valves -> speeds that the pumps can supply -> engine -> joint references -> torque limits
"""

from __future__ import annotations

from machine_sim.machine.hydraulic_kernels import advance_supply, limit_speeds, limit_torques
from machine_sim.machine.joint_reference import advance_references
from machine_sim.machine.joint_table import COMMAND
from machine_sim.machine.valves import DEMAND, advance_valves
from msg_bridge.kernels import kernel

__all__ = ["actuator_step"]


@kernel
def actuator_step(  # type: ignore[no-untyped-def]
    dt, valves, joints, cylinders, motors, supply, track_forces, track_speeds
):
    """Advance the actuators by a time step.

    Args:
        dt: time step [s].
        valves: `Valves.table`, joints first, then left and right track.
        joints: table of the joints with their present motion; targets and limits are updated.
        cylinders, motors, supply: tables of the hydraulics.
        track_forces: drive forces of both tracks in the last step [N], shape (2,).
        track_speeds: out, belt speeds that the tracks are commanded to [m/s], shape (2,).
    """
    advance_valves(dt, valves)
    limit_speeds(valves[DEMAND], joints, cylinders, motors, supply, joints[COMMAND], track_speeds)
    advance_supply(dt, track_forces, supply)
    advance_references(dt, joints)
    limit_torques(dt, joints, cylinders, motors, supply)

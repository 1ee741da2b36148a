"""Hydraulics of the arm: attainable speeds, maximum forces and pressures of the cylinders.

One supply feeds all cylinders and hydraulic motors, those of swing and tracks included. A demanded
speed requires a flow; where all together require more than the pumps deliver, each gets the same
fraction of its flow. The flow of the pumps is limited by their power: high pressure reduces it. It
also falls with the speed of the engine, which droops under load. At the ends of the stroke the
outlet is throttled (cushioning). The main relief valve limits the force of a moving cylinder, so
that an arm against a stronger resistance stalls. A cylinder at rest is locked by its valve and
yields only when the load exceeds the port relief pressure. The torque of a cylinder on its joint
depends on the angle through the lever arm (`cylinder_linkage`).

Cylinders are described in `hydraulic_cylinder`, motors in `hydraulic_motor`, engine and pumps in
`hydraulic_supply`; the equations are in `hydraulic_kernels`. A joint with `max_effort` has a drive
of its own: a fixed limit of torque, no flow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.hydraulic_motor import HydraulicMotor, TravelMotor
from machine_sim.machine.hydraulic_supply import HydraulicSupply
from machine_sim.machine.hydraulic_tables import (
    ENGINE_SPEED,
    cylinder_table,
    motor_table,
    supply_table,
)
from msg_bridge.contract.cylinder_state import CylinderState

__all__ = ["HydraulicSystem"]


class HydraulicSystem:
    """The cylinders and motors of a machine and their supply.

    Attributes:
        cylinders: cylinders by the name of the joint that they drive.
        cylinder_table, motor_table, supply_table: the parts as kernels take them, see
            `hydraulic_tables`; the last one is also the state of engine and pumps.
    """

    def __init__(
        self,
        joints: Sequence[str],
        cylinders: Mapping[str, Cylinder],
        motors: Mapping[str, HydraulicMotor],
        travel_motor: TravelMotor | None,
        supply: HydraulicSupply | None,
    ) -> None:
        """
        Args:
            joints: names of all joints, in the order of all arrays here.
            cylinders: cylinders by joint name.
            motors: hydraulic motors by joint name.
            travel_motor: hydraulic motor of each track; None for tracks with a drive of their own.
            supply: pump and valves; None only without cylinders and motors.
        """
        self.cylinders = dict(cylinders)
        self._joints, self._supply = list(joints), supply
        self.cylinder_table = cylinder_table(joints, cylinders)
        self.motor_table = motor_table(joints, motors)
        self.supply_table = supply_table(supply, travel_motor)

    @property
    def engine_speed(self) -> float:
        """Speed of the engine over that without load."""
        return float(self.supply_table[ENGINE_SPEED])

    def states(
        self, angles: Sequence[float], rates: Sequence[float], efforts: Sequence[float]
    ) -> dict[str, CylinderState]:
        """Return length, speed, force and pressures of the cylinders, by joint name.

        Args:
            angles, rates, efforts: joint angles [rad], speeds [rad/s] and torques [N m].
        """
        states = {}
        for name, cylinder in self.cylinders.items():
            i, linkage = self._joints.index(name), cylinder.linkage
            length, lever_arm = linkage.length_and_lever_arm(
                min(max(angles[i], linkage.lower), linkage.upper)
            )
            force = efforts[i] / lever_arm
            states[name] = CylinderState(
                length,
                lever_arm * rates[i],
                force,
                *self._pressures(cylinder, force),
            )
        return states

    def _pressures(self, cylinder: Cylinder, force: float) -> tuple[float, float]:
        """Return the pressures on cap side and rod side [Pa] at a force [N].

        One side is connected to the tank and has the return pressure.
        """
        assert self._supply is not None
        back_pressure = self._supply.return_pressure
        cap, rod = cylinder.cap_side_area, cylinder.rod_side_area
        if force + back_pressure * rod >= back_pressure * cap:
            return (force + back_pressure * rod) / cap, back_pressure
        return back_pressure, (back_pressure * cap - force) / rod

"""Reads the hydraulic motors of a machine file."""

from __future__ import annotations

from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulic_motor import HydraulicMotor
from machine_sim.machine.hydraulics import HydraulicSupply
from machine_sim.machine.spec_file.section import Section

__all__ = ["read_motor"]


def read_motor(name: str, section: Section, supply: HydraulicSupply) -> HydraulicMotor:
    """Read the hydraulic motor of one joint.

    Args:
        name: name of the joint, for messages.
        section: the section `motor` of the joint.
        supply: pump and valves of the machine.
    """
    motor = HydraulicMotor(
        displacement=section.number("displacement", positive=True),
        relief_pressure=section.number("relief_pressure", positive=True),
        brake_relief_pressure=section.number("brake_relief_pressure", positive=True),
        pressure_rise_time=section.number("pressure_rise_time", positive=True),
        holding_torque=section.number("holding_torque", positive=True),
    )
    section.reject_unknown_keys()
    for key in ("relief_pressure", "brake_relief_pressure"):
        pressure = getattr(motor, key)
        if pressure <= supply.return_pressure:
            raise MachineError(
                f"joints.{name}.motor.{key} is {pressure:g} Pa; give more than"
                f" hydraulics.return_pressure, {supply.return_pressure:g} Pa"
            )
    return motor

"""Reads the hydraulic motors of a machine file."""

from __future__ import annotations

from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulic_motor import HydraulicMotor, TravelMotor
from machine_sim.machine.hydraulic_supply import HydraulicSupply
from machine_sim.machine.spec_file.section import Section

__all__ = ["read_motor", "read_travel_motor"]


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
    _check_pressure(f"joints.{name}.motor.relief_pressure", motor.relief_pressure, supply)
    _check_pressure(
        f"joints.{name}.motor.brake_relief_pressure", motor.brake_relief_pressure, supply
    )
    return motor


def read_travel_motor(section: Section, supply: HydraulicSupply | None) -> TravelMotor:
    """Read `tracks.motor`: the hydraulic motor of each track.

    Args:
        section: the section `motor` of the tracks.
        supply: pump and valves of the machine.
    """
    if supply is None:
        raise MachineError("tracks.motor needs a hydraulic supply; add `hydraulics`")
    motor = TravelMotor(
        relief_pressure=section.number("relief_pressure", positive=True),
        min_displacement=section.number("min_displacement", positive=True),
    )
    section.reject_unknown_keys()
    _check_pressure("tracks.motor.relief_pressure", motor.relief_pressure, supply)
    return motor


def _check_pressure(key: str, pressure: float, supply: HydraulicSupply) -> None:
    """Check that a relief pressure [Pa] is above that of the line to the tank."""
    if pressure <= supply.return_pressure:
        raise MachineError(
            f"{key} is {pressure:g} Pa; give more than hydraulics.return_pressure,"
            f" {supply.return_pressure:g} Pa"
        )

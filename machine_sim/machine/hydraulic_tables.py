"""Hydraulics of a machine as tables for kernels, see `hydraulics`.

Kernels take few arrays faster than many, so that each kind of part is one array with named slots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.hydraulic_motor import HydraulicMotor, TravelMotor
from machine_sim.machine.hydraulic_supply import HydraulicSupply

__all__ = ["cylinder_table", "motor_table", "supply_table"]

Array = NDArray[np.float64]

JOINT = 0
"""Column of the index of the joint, in the tables of cylinders and of motors."""

LOWER, UPPER = range(1, 3)
"""Columns of the range of a cylinder's linkage [rad]."""
JOINT_X, JOINT_Z, BARREL_X, BARREL_Z, ROD_X, ROD_Z = range(3, 9)
"""Columns of the pins of a linkage [m], see `CylinderLinkage`; the rod's is NaN with a rocker."""
PIN_X, PIN_Z, ROCKER_LENGTH, COUPLER_LENGTH, COUPLER_X, COUPLER_Z = range(9, 15)
"""Columns of the rocker of a linkage [m], NaN without a rocker."""
MIN_LENGTH, MAX_LENGTH, CUSHION_LENGTH = range(15, 18)
"""Columns of lengths of a cylinder [m]."""
CAP_SIDE_AREA, ROD_SIDE_AREA, MAX_FLOW = range(18, 21)
"""Columns of areas of the pistons [m^2] and of the maximum flow [m^3/s]."""
_NUM_CYLINDER_SLOTS = 21

(
    DISPLACEMENT,
    RELIEF_PRESSURE,
    BRAKE_RELIEF_PRESSURE,
    PRESSURE_RISE_TIME,
    HOLDING_TORQUE,
) = range(1, 6)
"""Columns of the table of motors, see `HydraulicMotor`."""
_NUM_MOTOR_SLOTS = 6

(
    MAIN_RELIEF_PRESSURE,
    PORT_RELIEF_PRESSURE,
    RETURN_PRESSURE,
    PUMP_FLOW,
    PUMP_POWER,
    ENGINE_POWER,
    ENGINE_DROOP,
    ENGINE_RESPONSE_TIME,
) = range(8)
"""Slots of the supply, see `HydraulicSupply`."""
TRAVEL_RELIEF_PRESSURE, TRAVEL_MIN_DISPLACEMENT = range(8, 10)
"""Slots of the travel motors, see `TravelMotor`; NaN for tracks with a drive of their own."""
ENGINE_SPEED, POWER = range(10, 12)
"""Slots of the state of the supply: speed of the engine over that without load, and hydraulic power
of the last step [W]."""
TRACK_FORCES = 12
"""First of two slots of the mean drive forces of left and right track [N]."""
_NUM_SUPPLY_SLOTS = 14


def cylinder_table(joints: Sequence[str], cylinders: Mapping[str, Cylinder]) -> Array:
    """Return the cylinders, shape (cylinders, 21).

    Args:
        joints: names of all joints.
        cylinders: cylinders by joint name.
    """
    table = np.full((len(cylinders), _NUM_CYLINDER_SLOTS), np.nan)
    for row, (name, cylinder) in zip(table, cylinders.items(), strict=True):
        linkage = cylinder.linkage
        row[JOINT] = joints.index(name)
        row[LOWER], row[UPPER] = linkage.lower, linkage.upper
        row[JOINT_X : JOINT_Z + 1] = linkage.joint
        row[BARREL_X : BARREL_Z + 1] = linkage.barrel
        if linkage.rod is not None:
            row[ROD_X : ROD_Z + 1] = linkage.rod
        if linkage.rocker is not None:
            rocker = linkage.rocker
            row[PIN_X : PIN_Z + 1] = rocker.pin
            row[ROCKER_LENGTH], row[COUPLER_LENGTH] = rocker.length, rocker.coupler_length
            row[COUPLER_X : COUPLER_Z + 1] = rocker.coupler_pin
        row[MIN_LENGTH], row[MAX_LENGTH] = linkage.min_length, linkage.max_length
        row[CUSHION_LENGTH] = cylinder.cushion_length
        row[CAP_SIDE_AREA], row[ROD_SIDE_AREA] = cylinder.cap_side_area, cylinder.rod_side_area
        row[MAX_FLOW] = cylinder.max_flow
    return table


def motor_table(joints: Sequence[str], motors: Mapping[str, HydraulicMotor]) -> Array:
    """Return the hydraulic motors of joints, shape (motors, 6); arguments as above."""
    table = np.zeros((len(motors), _NUM_MOTOR_SLOTS))
    for row, (name, motor) in zip(table, motors.items(), strict=True):
        row[JOINT] = joints.index(name)
        row[DISPLACEMENT] = motor.displacement
        row[RELIEF_PRESSURE] = motor.relief_pressure
        row[BRAKE_RELIEF_PRESSURE] = motor.brake_relief_pressure
        row[PRESSURE_RISE_TIME] = motor.pressure_rise_time
        row[HOLDING_TORQUE] = motor.holding_torque
    return table


def supply_table(supply: HydraulicSupply | None, travel_motor: TravelMotor | None) -> Array:
    """Return engine, pumps and travel motors without load, shape (14,).

    Without a supply the parameters are NaN: there are neither cylinders nor motors.
    """
    table = np.full(_NUM_SUPPLY_SLOTS, np.nan)
    if supply is not None:
        table[MAIN_RELIEF_PRESSURE] = supply.main_relief_pressure
        table[PORT_RELIEF_PRESSURE] = supply.port_relief_pressure
        table[RETURN_PRESSURE] = supply.return_pressure
        table[PUMP_FLOW], table[PUMP_POWER] = supply.pump_flow, supply.pump_power
        table[ENGINE_POWER], table[ENGINE_DROOP] = supply.engine_power, supply.engine_droop
        table[ENGINE_RESPONSE_TIME] = supply.engine_response_time
    if travel_motor is not None:
        table[TRAVEL_RELIEF_PRESSURE] = travel_motor.relief_pressure
        table[TRAVEL_MIN_DISPLACEMENT] = travel_motor.min_displacement
    table[ENGINE_SPEED], table[POWER], table[TRACK_FORCES:] = 1.0, 0.0, 0.0
    return table

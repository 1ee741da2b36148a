"""Kernels of the hydraulics: attainable speeds, engine and pumps, and torque limits.

The tables are those of `hydraulic_tables` and `joint_table`; the model is described in `hydraulics`
and `hydraulic_motor`.
"""

from __future__ import annotations

import math

from machine_sim.machine.hydraulic_tables import (
    BRAKE_RELIEF_PRESSURE,
    CAP_SIDE_AREA,
    CUSHION_LENGTH,
    DISPLACEMENT,
    ENGINE_DROOP,
    ENGINE_POWER,
    ENGINE_RESPONSE_TIME,
    ENGINE_SPEED,
    HOLDING_TORQUE,
    JOINT,
    MAIN_RELIEF_PRESSURE,
    MAX_FLOW,
    MAX_LENGTH,
    MIN_LENGTH,
    PORT_RELIEF_PRESSURE,
    POWER,
    PRESSURE_RISE_TIME,
    PUMP_FLOW,
    PUMP_POWER,
    RELIEF_PRESSURE,
    RETURN_PRESSURE,
    ROD_SIDE_AREA,
    TRACK_FORCES,
    TRAVEL_MIN_DISPLACEMENT,
    TRAVEL_RELIEF_PRESSURE,
)
from machine_sim.machine.joint_table import (
    ANGLE,
    EFFORT,
    IS_HOLDING,
    MAX_EFFORT,
    RATE,
    TARGET_RATE,
    TORQUE_LIMIT,
)
from machine_sim.machine.linkage_kernels import length_and_lever_arm
from msg_bridge.kernels import helper

__all__ = ["advance_supply", "limit_speeds", "limit_torques"]

_MIN_CUSHION_SPEED = 0.15
"""Fraction of the full speed that the cushion allows at the end of the stroke."""

_PRESSURE_RESPONSE_TIME = 0.1
"""Time constant of the pressure of the travel motors [s]: the forces of hinged shoes on their
sprocket vary from step to step, and pumps do not follow such peaks."""

_REVERSAL_RATE = 0.02
"""Difference between demanded and actual speed above which a motor reverses its torque [rad/s];
below it the pressure follows the load without a drop."""


@helper(allocates=True)
def limit_speeds(demand, joints, cylinders, motors, supply, speeds, track_speeds):  # type: ignore[no-untyped-def]
    """Find the speeds of joints and tracks that the pumps can supply.

    Args:
        demand: speeds that the valves demand: joints [rad/s], then left and right track [m/s].
        joints: table of the joints. The pumps supply the largest pressure of the moving cylinders
            and motors, at the torques of the last step.
        cylinders, motors: their tables.
        supply: table of the supply; its hydraulic power is updated.
        speeds, track_speeds: out, speeds of the joints [rad/s] and tracks [m/s].
    """
    num_joints = joints.shape[1]
    speeds[:] = demand[:num_joints]
    track_speeds[:] = demand[num_joints:]
    back_pressure = supply[RETURN_PRESSURE]
    if math.isnan(back_pressure):
        return
    required, pressure = 0.0, back_pressure
    for k in range(len(cylinders)):
        cylinder = cylinders[k]
        i = int(cylinder[JOINT])
        if demand[i] == 0.0:
            continue
        length, lever_arm = length_and_lever_arm(cylinder, joints[ANGLE, i])
        speed = lever_arm * demand[i]
        speed *= _cushion_factor(cylinder, length, speed)
        is_extending = speed > 0.0
        flow = abs(speed) * (cylinder[CAP_SIDE_AREA] if is_extending else cylinder[ROD_SIDE_AREA])
        share = min(1.0, cylinder[MAX_FLOW] * supply[ENGINE_SPEED] / flow)
        speeds[i] = share * speed / lever_arm
        required += share * flow
        driving = _driving_pressure(
            cylinder, joints[EFFORT, i] / lever_arm, back_pressure, is_extending
        )
        pressure = max(pressure, driving)
    for k in range(len(motors)):
        motor = motors[k]
        i = int(motor[JOINT])
        # What the motor cannot take while it accelerates returns over its relief valve.
        required += motor[DISPLACEMENT] * abs(demand[i])
        effort = joints[EFFORT, i]
        if effort * demand[i] > 0.0:
            pressure = max(pressure, back_pressure + abs(effort) / motor[DISPLACEMENT])
    has_travel_motors = not math.isnan(supply[TRAVEL_RELIEF_PRESSURE])
    if has_travel_motors:
        for side in range(2):
            speed, force = demand[num_joints + side], supply[TRACK_FORCES + side]
            displacement = max(
                supply[TRAVEL_MIN_DISPLACEMENT],
                abs(force) / (supply[TRAVEL_RELIEF_PRESSURE] - back_pressure),
            )
            required += displacement * abs(speed)
            if force * speed > 0.0:
                pressure = max(pressure, back_pressure + abs(force) / displacement)
    flow = min(supply[PUMP_FLOW] * supply[ENGINE_SPEED], supply[PUMP_POWER] / pressure)
    if required > flow:
        share = flow / required
        for k in range(len(cylinders)):
            speeds[int(cylinders[k, JOINT])] *= share
        for k in range(len(motors)):
            speeds[int(motors[k, JOINT])] *= share
        if has_travel_motors:
            track_speeds[0], track_speeds[1] = share * track_speeds[0], share * track_speeds[1]
    supply[POWER] = min(flow, required) * pressure


@helper
def _cushion_factor(cylinder, length, speed):  # type: ignore[no-untyped-def]
    """Return the fraction of the full speed that the cushions of a cylinder allow."""
    stroke_left = cylinder[MAX_LENGTH] - length if speed > 0.0 else length - cylinder[MIN_LENGTH]
    return min(
        1.0,
        _MIN_CUSHION_SPEED
        + (1.0 - _MIN_CUSHION_SPEED) * max(stroke_left, 0.0) / cylinder[CUSHION_LENGTH],
    )


@helper
def _driving_pressure(cylinder, force, back_pressure, is_extending):  # type: ignore[no-untyped-def]
    """Return the pressure on the side of a cylinder that drives its motion [Pa], at a force [N].

    One side is connected to the tank and has the return pressure.
    """
    cap, rod = cylinder[CAP_SIDE_AREA], cylinder[ROD_SIDE_AREA]
    if force + back_pressure * rod >= back_pressure * cap:
        return (force + back_pressure * rod) / cap if is_extending else back_pressure
    return back_pressure if is_extending else (back_pressure * cap - force) / rod


@helper
def advance_supply(dt, track_forces, supply):  # type: ignore[no-untyped-def]
    """Advance the state of engine and travel motors by a time step.

    The engine has the load of the last attainable speeds.

    Args:
        dt: time step [s].
        track_forces: drive forces of both tracks in the last step [N].
        supply: table of the supply; its engine speed and track forces are updated.
    """
    if math.isnan(supply[RETURN_PRESSURE]):
        return
    load = min(supply[POWER] / supply[ENGINE_POWER], 1.0)
    change = 1.0 - supply[ENGINE_DROOP] * load - supply[ENGINE_SPEED]
    supply[ENGINE_SPEED] += change * min(dt / supply[ENGINE_RESPONSE_TIME], 1.0)
    weight = min(dt / _PRESSURE_RESPONSE_TIME, 1.0)
    for side in range(2):
        mean = supply[TRACK_FORCES + side]
        supply[TRACK_FORCES + side] = mean + weight * (track_forces[side] - mean)


@helper(allocates=True)
def limit_torques(dt, joints, cylinders, motors, supply):  # type: ignore[no-untyped-def]
    """Find the maximum torque of each joint in the direction of its present torque.

    Args:
        dt: time step [s].
        joints: table of the joints; their torque limits are updated. A valve is closed at a target
            rate of zero.
        cylinders, motors, supply: their tables.
    """
    joints[TORQUE_LIMIT] = joints[MAX_EFFORT]
    back_pressure = supply[RETURN_PRESSURE]
    for k in range(len(cylinders)):
        cylinder = cylinders[k]
        i = int(cylinder[JOINT])
        _, lever_arm = length_and_lever_arm(cylinder, joints[ANGLE, i])
        is_open = joints[TARGET_RATE, i] != 0.0
        pressure = supply[MAIN_RELIEF_PRESSURE] if is_open else supply[PORT_RELIEF_PRESSURE]
        driving, opposing = cylinder[CAP_SIDE_AREA], cylinder[ROD_SIDE_AREA]
        if not joints[EFFORT, i] * lever_arm >= 0.0:
            driving, opposing = opposing, driving
        force = pressure * driving - back_pressure * opposing
        joints[TORQUE_LIMIT, i] = abs(lever_arm) * force
    for k in range(len(motors)):
        i = int(motors[k, JOINT])
        joints[TORQUE_LIMIT, i] = (
            motors[k, HOLDING_TORQUE]
            if joints[IS_HOLDING, i]
            else _moving_torque_limit(
                dt,
                motors[k],
                joints[RATE, i],
                joints[TARGET_RATE, i],
                joints[EFFORT, i],
                back_pressure,
            )
        )


@helper
def _moving_torque_limit(dt, motor, rate, target_rate, torque, back_pressure):  # type: ignore[no-untyped-def]
    """Return the maximum torque of a turning motor in the next step [N m].

    Args:
        dt: time step [s].
        motor: row of the table of motors.
        rate: joint speed [rad/s].
        target_rate: joint speed that the valve demands [rad/s]; zero with closed ports.
        torque: torque of the last step [N m].
        back_pressure: pressure in the line to the tank [Pa].
    """
    change = target_rate - rate
    is_braking = change * rate < 0.0
    pressure = motor[BRAKE_RELIEF_PRESSURE] if is_braking else motor[RELIEF_PRESSURE]
    full = motor[DISPLACEMENT] * (pressure - back_pressure)
    rise = full * dt / motor[PRESSURE_RISE_TIME]
    # Only one side of the motor has pressure; that on the other side builds up from zero.
    is_reversing = torque * change < 0.0 and abs(change) > _REVERSAL_RATE
    built_up = 0.0 if is_reversing else abs(torque)
    return min(full, built_up + rise)

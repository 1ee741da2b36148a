"""Hydraulics of the arm: attainable speeds, maximum forces and pressures of the cylinders.

One supply feeds all cylinders and hydraulic motors, those of swing and tracks included. A demanded
speed requires a flow; where all together require more than the pumps deliver, each gets the same
fraction of its flow. The flow of the pumps is limited by their power: high pressure reduces it. It
also falls with the speed of the engine, which droops under load. At the ends of the stroke the
outlet is throttled (cushioning). The main relief valve limits the force of a moving cylinder, so
that an arm against a stronger resistance stalls. A cylinder at rest is locked by its valve and
yields only when the load exceeds the port relief pressure. The torque of a cylinder on its joint
depends on the angle through the lever arm (`cylinder_linkage`).

Hydraulic motors are described in `hydraulic_motor`, engine and pumps in `hydraulic_supply`. A joint
with `max_effort` has a drive of its own: a fixed limit of torque, no flow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from machine_sim.machine.cylinder_linkage import CylinderLinkage
from machine_sim.machine.hydraulic_motor import HydraulicMotor, TravelMotor
from machine_sim.machine.hydraulic_supply import HydraulicSupply, Pump
from msg_bridge.contract.cylinder_state import CylinderState

__all__ = ["Cylinder", "HydraulicSystem"]

_MIN_CUSHION_SPEED = 0.15
"""Fraction of the full speed that the cushion allows at the end of the stroke."""

_PRESSURE_RESPONSE_TIME = 0.1
"""Time constant of the pressure of the travel motors [s]: the forces of hinged shoes on their
sprocket vary from step to step, and pumps do not follow such peaks."""


@dataclass(frozen=True)
class Cylinder:
    """Parallel cylinders that drive one joint.

    Attributes:
        linkage: geometry between cylinder and joint.
        bore, rod_diameter: inner diameter of the barrel, and diameter of the rod [m].
        count: number of cylinders.
        spread: lateral distance between the outer cylinders [m].
        cushion_length: length of the cushion at both ends of the stroke [m].
        max_flow: maximum flow that its valves let through, of one pump or of all [m^3/s].
    """

    linkage: CylinderLinkage
    bore: float
    rod_diameter: float
    count: int
    spread: float
    cushion_length: float
    max_flow: float

    @cached_property
    def cap_side_area(self) -> float:
        """Area of all pistons on the cap side [m^2]."""
        return 0.25 * math.pi * self.count * self.bore**2

    @cached_property
    def rod_side_area(self) -> float:
        """Area of all pistons on the rod side [m^2]."""
        return 0.25 * math.pi * self.count * (self.bore**2 - self.rod_diameter**2)

    def force_limit(self, pressure: float, back_pressure: float, *, is_extending: bool) -> float:
        """Return the maximum force [N] with `pressure` on the driving side of the pistons [Pa].

        Args:
            pressure: pressure on the driving side [Pa].
            back_pressure: pressure on the other side [Pa].
            is_extending: whether the cap side drives, so that the cylinder pushes.
        """
        driving, opposing = self.cap_side_area, self.rod_side_area
        if not is_extending:
            driving, opposing = opposing, driving
        return pressure * driving - back_pressure * opposing


class _CylinderGeometry(NamedTuple):
    """A joint angle [rad], and the cylinder's length [m] and lever arm [m/rad] at that angle."""

    angle: float
    length: float
    lever_arm: float


class HydraulicSystem:
    """The cylinders and motors of a machine and their supply.

    Attributes:
        cylinders: cylinders by the name of the joint that they drive.
        pump: engine and pumps; None without cylinders and hydraulic motors.
    """

    def __init__(
        self,
        joints: Sequence[str],
        torques: Sequence[float],
        cylinders: Mapping[str, Cylinder],
        motors: Mapping[str, HydraulicMotor],
        travel_motor: TravelMotor | None,
        supply: HydraulicSupply | None,
    ) -> None:
        """
        Args:
            joints: names of all joints, in the order of all arrays here.
            torques: maximum torque of each joint [N m], used for joints with neither cylinder nor
                hydraulic motor.
            cylinders: cylinders by joint name.
            motors: hydraulic motors by joint name.
            travel_motor: hydraulic motor of each track; None for tracks with a drive of their own.
            supply: pump and valves; None only without cylinders and motors.
        """
        self.cylinders = dict(cylinders)
        self._torques = list(torques)
        self._supply = supply
        self.pump = Pump(supply) if supply is not None else None
        self._travel_motor = travel_motor
        self._power = 0.0
        self._track_forces = [0.0, 0.0]  # averaged over `_PRESSURE_RESPONSE_TIME`
        self._driven_joints = [
            (joints.index(name), cylinder) for name, cylinder in cylinders.items()
        ]
        self._motors = [(joints.index(name), motor) for name, motor in motors.items()]
        # Geometry at the last angle, by joint: one step needs it several times.
        self._geometry_cache: dict[int, _CylinderGeometry] = {}

    def attainable_speeds(
        self,
        speeds: Sequence[float],
        angles: Sequence[float],
        efforts: Sequence[float],
        track_speeds: Sequence[float] = (0.0, 0.0),
    ) -> tuple[list[float], list[float]]:
        """Return the speeds of joints [rad/s] and tracks [m/s] that the pumps can supply.

        Args:
            speeds: joint speeds that the valves demand [rad/s].
            angles: joint angles [rad].
            efforts: torques of the last step [N m]; the pumps supply the largest pressure of the
                moving cylinders and motors.
            track_speeds: belt speeds that the valves demand, left and right [m/s].
        """
        attainable, tracks = list(speeds), list(track_speeds)
        if self._supply is None or self.pump is None:
            return attainable, tracks
        back_pressure = self._supply.return_pressure
        demand, pressure = 0.0, back_pressure
        for i, cylinder in self._driven_joints:
            if speeds[i] == 0.0:
                continue
            _, length, lever_arm = self._geometry_at(i, cylinder, angles[i])
            speed = (
                lever_arm
                * speeds[i]
                * self._cushion_factor(cylinder, length, lever_arm * speeds[i])
            )
            is_extending = speed > 0.0
            area = cylinder.cap_side_area if is_extending else cylinder.rod_side_area
            flow = abs(speed) * area
            max_flow = cylinder.max_flow * self.pump.engine_speed
            share = min(1.0, max_flow / flow)
            attainable[i] = share * speed / lever_arm
            demand += share * flow
            cap_side, rod_side = self._pressures(cylinder, efforts[i] / lever_arm)
            pressure = max(pressure, cap_side if is_extending else rod_side)
        for i, motor in self._motors:
            # What the motor cannot take while it accelerates returns over its relief valve.
            demand += motor.displacement * abs(speeds[i])
            if efforts[i] * speeds[i] > 0.0:
                pressure = max(pressure, motor.pressure(efforts[i], back_pressure))
        if self._travel_motor is not None:
            for speed, force in zip(track_speeds, self._track_forces, strict=True):
                displacement = self._travel_motor.displacement(force, back_pressure)
                demand += displacement * abs(speed)
                if force * speed > 0.0:
                    pressure = max(pressure, back_pressure + abs(force) / displacement)
        flow = self.pump.max_flow(pressure)
        if demand > flow:
            share = flow / demand
            for i, _ in (*self._driven_joints, *self._motors):
                attainable[i] *= share
            if self._travel_motor is not None:
                tracks = [share * speed for speed in tracks]
        self._power = min(flow, demand) * pressure
        return attainable, tracks

    def advance(self, dt: float, track_forces: Sequence[float]) -> None:
        """Advance the state of engine and travel motors by `dt` [s].

        The engine has the load of the last attainable speeds.

        Args:
            dt: time step [s].
            track_forces: drive forces of both tracks in the last step [N].
        """
        if self.pump is None:
            return
        self.pump.advance(dt, self._power)
        weight = min(dt / _PRESSURE_RESPONSE_TIME, 1.0)
        self._track_forces = [
            mean + weight * (force - mean)
            for mean, force in zip(self._track_forces, track_forces, strict=True)
        ]

    def torque_limits(
        self,
        dt: float,
        target_rates: Sequence[float],
        is_holding: Sequence[bool],
        angles: Sequence[float],
        rates: Sequence[float],
        efforts: Sequence[float],
    ) -> list[float]:
        """Return the maximum torque of each joint in the direction of its present torque [N m].

        Args:
            dt: time step [s].
            target_rates: joint speeds that the valves demand [rad/s]; at zero they are closed.
            is_holding: whether the parking brake of a joint with a motor is engaged.
            angles, rates: joint angles [rad] and speeds [rad/s].
            efforts: torques of the last step [N m]; the sign gives the direction of the force.
        """
        limits = self._torques.copy()
        for i, cylinder in self._driven_joints:
            assert self._supply is not None
            lever_arm, supply = self._geometry_at(i, cylinder, angles[i]).lever_arm, self._supply
            limits[i] = abs(lever_arm) * cylinder.force_limit(
                supply.main_relief_pressure if target_rates[i] else supply.port_relief_pressure,
                supply.return_pressure,
                is_extending=efforts[i] * lever_arm >= 0.0,
            )
        for i, motor in self._motors:
            assert self._supply is not None
            limits[i] = (
                motor.holding_torque
                if is_holding[i]
                else motor.moving_torque_limit(
                    dt, rates[i], target_rates[i], efforts[i], self._supply.return_pressure
                )
            )
        return limits

    def states(
        self, angles: Sequence[float], rates: Sequence[float], efforts: Sequence[float]
    ) -> dict[str, CylinderState]:
        """Return length, speed, force and pressures of the cylinders, by joint name.

        Args:
            angles, rates, efforts: joint angles [rad], speeds [rad/s] and torques [N m].
        """
        states = {}
        for name, (i, cylinder) in zip(self.cylinders, self._driven_joints, strict=True):
            _, length, lever_arm = self._geometry_at(i, cylinder, angles[i])
            force = efforts[i] / lever_arm
            states[name] = CylinderState(
                length,
                lever_arm * rates[i],
                force,
                *self._pressures(cylinder, force),
            )
        return states

    def _geometry_at(self, joint: int, cylinder: Cylinder, angle: float) -> _CylinderGeometry:
        """Return length and lever arm at a joint angle [rad], clamped to the linkage's range."""
        linkage = cylinder.linkage
        angle = min(max(angle, linkage.lower), linkage.upper)
        known = self._geometry_cache.get(joint)
        if known is None or known.angle != angle:
            known = _CylinderGeometry(angle, *linkage.length_and_lever_arm(angle))
            self._geometry_cache[joint] = known
        return known

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

    @staticmethod
    def _cushion_factor(cylinder: Cylinder, length: float, speed: float) -> float:
        """Return the fraction of the full speed that the cushions allow."""
        linkage = cylinder.linkage
        stroke_left = linkage.max_length - length if speed > 0.0 else length - linkage.min_length
        return min(
            1.0,
            _MIN_CUSHION_SPEED
            + (1.0 - _MIN_CUSHION_SPEED) * max(stroke_left, 0.0) / cylinder.cushion_length,
        )

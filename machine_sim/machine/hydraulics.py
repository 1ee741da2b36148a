"""Hydraulics of the arm: attainable speeds, maximum forces and pressures of the cylinders.

One pump feeds all cylinders. A commanded speed requires a flow; where all cylinders together
require more than the pump delivers, each gets the same fraction of its flow. The flow of the pump
is limited by its power: high pressure reduces it. At the ends of the stroke the outlet is
throttled (cushioning). The main relief valve limits the force of a moving cylinder, so that an arm
against a stronger resistance stalls. A cylinder at rest is locked by its valve and yields only
when the load exceeds the port relief pressure. The torque of a cylinder on its joint depends on
the angle through the lever arm (`cylinder_linkage`).

A hydraulic motor, such as that of the swing, is fed by the same pump; see `hydraulic_motor`. A
joint with `max_effort` has a drive of its own: a fixed limit of torque, no flow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from machine_sim.machine.cylinder_linkage import CylinderLinkage
from machine_sim.machine.hydraulic_motor import HydraulicMotor
from msg_bridge.contract.cylinder_state import CylinderState

__all__ = ["Cylinder", "HydraulicSupply", "HydraulicSystem"]

_MIN_CUSHION_SPEED = 0.15
"""Fraction of the full speed that the cushion allows at the end of the stroke."""


@dataclass(frozen=True)
class HydraulicSupply:
    """Pump and valves.

    Attributes:
        main_relief_pressure: maximum pressure on the pump side [Pa].
        port_relief_pressure: pressure at which a locked cylinder yields [Pa].
        return_pressure: pressure in the line to the tank [Pa].
        pump_flow: maximum flow of all pumps together [m^3/s].
        pump_power: maximum power of all pumps together [W].
    """

    main_relief_pressure: float
    port_relief_pressure: float
    return_pressure: float
    pump_flow: float
    pump_power: float


@dataclass(frozen=True)
class Cylinder:
    """Parallel cylinders that drive one joint.

    Attributes:
        linkage: geometry between cylinder and joint.
        bore, rod_diameter: inner diameter of the barrel, and diameter of the rod [m].
        count: number of cylinders.
        spread: lateral distance between the outer cylinders [m].
        cushion_length: length of the cushion at both ends of the stroke [m].
    """

    linkage: CylinderLinkage
    bore: float
    rod_diameter: float
    count: int
    spread: float
    cushion_length: float

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
    """

    def __init__(
        self,
        joints: Sequence[str],
        torques: Sequence[float],
        cylinders: Mapping[str, Cylinder],
        motors: Mapping[str, HydraulicMotor],
        supply: HydraulicSupply | None,
    ) -> None:
        """
        Args:
            joints: names of all joints, in the order of all arrays here.
            torques: maximum torque of each joint [N m], used for joints with neither cylinder nor
                hydraulic motor.
            cylinders: cylinders by joint name.
            motors: hydraulic motors by joint name.
            supply: pump and valves; None only without cylinders and motors.
        """
        self.cylinders = dict(cylinders)
        self._torques = list(torques)
        self._supply = supply
        self._driven_joints = [
            (joints.index(name), cylinder) for name, cylinder in cylinders.items()
        ]
        self._motors = [(joints.index(name), motor) for name, motor in motors.items()]
        # Geometry at the last angle, by joint: one step needs it several times.
        self._geometry_cache: dict[int, _CylinderGeometry] = {}

    def attainable_speeds(
        self, speeds: Sequence[float], angles: Sequence[float], efforts: Sequence[float]
    ) -> list[float]:
        """Return the joint speeds for which the pump delivers enough flow [rad/s].

        Args:
            speeds: commanded joint speeds [rad/s].
            angles: joint angles [rad].
            efforts: torques of the last step [N m]; the pump supplies the largest pressure of the
                moving cylinders and motors.
        """
        attainable = list(speeds)
        if self._supply is None:
            return attainable
        demand, pressure = 0.0, self._supply.return_pressure
        for i, cylinder in self._driven_joints:
            if speeds[i] == 0.0:
                continue
            _, length, lever_arm = self._geometry_at(i, cylinder, angles[i])
            speed = (
                lever_arm
                * speeds[i]
                * self._cushion_factor(cylinder, length, lever_arm * speeds[i])
            )
            attainable[i] = speed / lever_arm
            is_extending = speed > 0.0
            demand += abs(speed) * (
                cylinder.cap_side_area if is_extending else cylinder.rod_side_area
            )
            cap_side, rod_side = self._pressures(cylinder, efforts[i] / lever_arm)
            pressure = max(pressure, cap_side if is_extending else rod_side)
        for i, motor in self._motors:
            # What the motor cannot take while it accelerates returns over its relief valve.
            demand += motor.displacement * abs(speeds[i])
            if efforts[i] * speeds[i] > 0.0:
                pressure = max(pressure, motor.pressure(efforts[i], self._supply.return_pressure))
        flow = min(self._supply.pump_flow, self._supply.pump_power / pressure)
        if demand > flow:
            for i, _ in (*self._driven_joints, *self._motors):
                attainable[i] *= flow / demand
        return attainable

    def torque_limits(
        self,
        dt: float,
        target_rates: Sequence[float],
        angles: Sequence[float],
        rates: Sequence[float],
        efforts: Sequence[float],
    ) -> list[float]:
        """Return the maximum torque of each joint in the direction of its present torque [N m].

        Args:
            dt: time step [s].
            target_rates: joint speeds that the valves demand [rad/s]; at zero they are closed.
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
            limits[i] = motor.torque_limit(
                dt, rates[i], target_rates[i], efforts[i], self._supply.return_pressure
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

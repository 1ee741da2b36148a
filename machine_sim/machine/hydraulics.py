"""Hydraulics of the arm: how fast and how hard its cylinders can move it, and at what pressures.

One pump feeds all cylinders. A lever asks for a speed, which takes flow; where all together ask for
more than the pump gives, each gets the same share of what it asked for. The pump gives less at high
pressure, so that it takes no more than its power. At the ends of a stroke the outlet is throttled
(*cushion*). A driven cylinder pushes no harder than the relief valve lets it, so an arm that meets
something too strong stands still; one that is held is locked in by its valve, and yields only where
the load beats the port's own relief. What a cylinder's force does to its joint changes with the
angle, by the lever arm (`linkage`).

A swing motor or any joint without a cylinder has a limit of torque and speed, and no part in this.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from machine_sim.machine.cylinder_linkage import CylinderLinkage
from msg_bridge.contract.cylinder_state import CylinderState

__all__ = ["Cylinder", "HydraulicSupply", "HydraulicSystem"]

_MIN_CUSHION_SPEED = 0.15
"""Part of the full speed that a cushion lets through at the very end."""


@dataclass(frozen=True)
class HydraulicSupply:
    """Pump and valves.

    Attributes:
        main_relief_pressure: most that the pump side reaches [Pa].
        port_relief_pressure: at which a cylinder that is locked in yields [Pa].
        return_pressure: on the way back to the tank [Pa].
        pump_flow: most that all pumps give together [m^3/s].
        pump_power: most that they take [W].
    """

    main_relief_pressure: float
    port_relief_pressure: float
    return_pressure: float
    pump_flow: float
    pump_power: float


@dataclass(frozen=True)
class Cylinder:
    """Cylinders side by side that turn one joint.

    Attributes:
        linkage: where they are pinned.
        bore, rod_diameter: inner diameter of the barrel, and of the rod [m].
        count: how many.
        spread: distance between the outer ones across the machine [m].
        cushion: length of stroke at both ends over which it slows down [m].
    """

    linkage: CylinderLinkage
    bore: float
    rod_diameter: float
    count: int
    spread: float
    cushion_length: float

    @cached_property
    def head_area(self) -> float:
        """Of all pistons on the side without a rod [m^2]."""
        return 0.25 * math.pi * self.count * self.bore**2

    @cached_property
    def rod_area(self) -> float:
        """Of all pistons on the side of the rod [m^2]."""
        return 0.25 * math.pi * self.count * (self.bore**2 - self.rod_diameter**2)

    def force_limit(self, pressure: float, back: float, *, pushes: bool) -> float:
        """Most it pushes or pulls [N] with a pressure behind the piston and another before it."""
        ahead, behind = (
            (self.rod_area, self.head_area) if pushes else (self.head_area, self.rod_area)
        )
        return pressure * behind - back * ahead


class _CylinderGeometry(NamedTuple):
    """A joint angle within the stroke [rad], the cylinder's length [m] and lever [m/rad] there."""

    angle: float
    length: float
    lever_arm: float


class HydraulicSystem:
    """The cylinders of a machine and what feeds them.

    Attributes:
        cylinders: by joint.
    """

    def __init__(
        self,
        joints: Sequence[str],
        torques: Sequence[float],
        cylinders: Mapping[str, Cylinder],
        supply: HydraulicSupply | None,
    ) -> None:
        """
        Args:
            joints: all joints, in the order of all arrays here.
            torques: greatest torque of each [N m], as far as it has no cylinder.
            cylinders: those that cylinders turn.
            supply: pump and valves; None only where there are no cylinders.
        """
        self.cylinders = dict(cylinders)
        self._torques = list(torques)
        self._supply = supply
        self._driven_joints = [
            (joints.index(name), cylinder) for name, cylinder in cylinders.items()
        ]
        self._geometry_cache: dict[
            int, _CylinderGeometry
        ] = {}  # by joint, the last that was asked for

    def attainable_speeds(
        self, speeds: Sequence[float], angles: Sequence[float], efforts: Sequence[float]
    ) -> list[float]:
        """Joint speeds that the pump can feed [rad/s].

        Args:
            speeds: wanted [rad/s].
            angles: of the joints [rad].
            efforts: torques of the last step [N m]: the pump is at the pressure of the heaviest.
        """
        given = list(speeds)
        if self._supply is None:
            return given
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
            given[i] = speed / lever_arm
            demand += abs(speed) * (cylinder.head_area if speed > 0.0 else cylinder.rod_area)
            head, rod = self._pressures(cylinder, efforts[i] / lever_arm)
            pressure = max(pressure, head if speed > 0.0 else rod)
        flow = min(self._supply.pump_flow, self._supply.pump_power / pressure)
        if demand > flow:
            for i, _ in self._driven_joints:
                given[i] *= flow / demand
        return given

    def torque_limits(
        self, moves: Sequence[bool], angles: Sequence[float], efforts: Sequence[float]
    ) -> list[float]:
        """Greatest torque of each joint in the direction in which it acts now [N m].

        Args:
            moves: whether it is driven, not held.
            angles: of the joints [rad].
            efforts: torques of the last step [N m]; their sign says whether a cylinder pushes.
        """
        limits = self._torques.copy()
        for i, cylinder in self._driven_joints:
            assert self._supply is not None
            lever_arm, supply = self._geometry_at(i, cylinder, angles[i]).lever_arm, self._supply
            limits[i] = abs(lever_arm) * cylinder.force_limit(
                supply.main_relief_pressure if moves[i] else supply.port_relief_pressure,
                supply.return_pressure,
                pushes=efforts[i] * lever_arm >= 0.0,
            )
        return limits

    def states(
        self, angles: Sequence[float], rates: Sequence[float], efforts: Sequence[float]
    ) -> dict[str, CylinderState]:
        """How the cylinders are doing, by joint.

        Args:
            angles, rates, efforts: of the joints [rad, rad/s, N m].
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
        """Where a cylinder is at a joint angle [rad]; a step asks for it several times."""
        linkage = cylinder.linkage
        angle = min(max(angle, linkage.lower), linkage.upper)
        known = self._geometry_cache.get(joint)
        if known is None or known.angle != angle:
            known = _CylinderGeometry(angle, *linkage.length_and_lever_arm(angle))
            self._geometry_cache[joint] = known
        return known

    def _pressures(self, cylinder: Cylinder, force: float) -> tuple[float, float]:
        """Head and rod pressure [Pa] at a force [N]: one side is open to the tank."""
        assert self._supply is not None
        back, head, rod = self._supply.return_pressure, cylinder.head_area, cylinder.rod_area
        if force + back * rod >= back * head:
            return (force + back * rod) / head, back
        return back, (back * head - force) / rod

    @staticmethod
    def _cushion_factor(cylinder: Cylinder, length: float, speed: float) -> float:
        """Part of the full speed that the cushions let through."""
        linkage = cylinder.linkage
        room = linkage.max_length - length if speed > 0.0 else length - linkage.min_length
        return min(
            1.0,
            _MIN_CUSHION_SPEED
            + (1.0 - _MIN_CUSHION_SPEED) * max(room, 0.0) / cylinder.cushion_length,
        )

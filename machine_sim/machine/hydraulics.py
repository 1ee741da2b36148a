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

from machine_sim.machine.linkage import CylinderLinkage
from msg_bridge.contract.cylinders import CylinderState

__all__ = ["Cylinder", "HydraulicArm", "HydraulicSupply"]

_CREEP = 0.15
"""Part of the full speed that a cushion lets through at the very end."""


@dataclass(frozen=True)
class HydraulicSupply:
    """Pump and valves.

    Attributes:
        relief_pressure: most that the pump side reaches [Pa].
        hold_pressure: at which a cylinder that is locked in yields [Pa].
        return_pressure: on the way back to the tank [Pa].
        pump_flow: most that all pumps give together [m^3/s].
        pump_power: most that they take [W].
    """

    relief_pressure: float
    hold_pressure: float
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
    cushion: float

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


class _Stroke(NamedTuple):
    """A joint angle within the stroke [rad], the cylinder's length [m] and lever [m/rad] there."""

    angle: float
    length: float
    lever: float


class HydraulicArm:
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
        self._turned = [(joints.index(name), cylinder) for name, cylinder in cylinders.items()]
        self._strokes: dict[int, _Stroke] = {}  # by joint, the last that was asked for

    def attainable(
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
        for i, cylinder in self._turned:
            if speeds[i] == 0.0:
                continue
            _, length, lever = self._stroke(i, cylinder, angles[i])
            speed = lever * speeds[i] * self._cushioned(cylinder, length, lever * speeds[i])
            given[i] = speed / lever
            demand += abs(speed) * (cylinder.head_area if speed > 0.0 else cylinder.rod_area)
            head, rod = self._pressures(cylinder, efforts[i] / lever)
            pressure = max(pressure, head if speed > 0.0 else rod)
        flow = min(self._supply.pump_flow, self._supply.pump_power / pressure)
        if demand > flow:
            for i, _ in self._turned:
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
        for i, cylinder in self._turned:
            assert self._supply is not None
            lever, supply = self._stroke(i, cylinder, angles[i]).lever, self._supply
            limits[i] = abs(lever) * cylinder.force_limit(
                supply.relief_pressure if moves[i] else supply.hold_pressure,
                supply.return_pressure,
                pushes=efforts[i] * lever >= 0.0,
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
        for name, (i, cylinder) in zip(self.cylinders, self._turned, strict=True):
            _, length, lever = self._stroke(i, cylinder, angles[i])
            force = efforts[i] / lever
            states[name] = CylinderState(
                length,
                lever * rates[i],
                force,
                *self._pressures(cylinder, force),
            )
        return states

    def _stroke(self, joint: int, cylinder: Cylinder, angle: float) -> _Stroke:
        """Where a cylinder is at a joint angle [rad]; a step asks for it several times."""
        linkage = cylinder.linkage
        angle = min(max(angle, linkage.lower), linkage.upper)
        known = self._strokes.get(joint)
        if known is None or known.angle != angle:
            known = _Stroke(angle, *linkage.length_and_lever(angle))
            self._strokes[joint] = known
        return known

    def _pressures(self, cylinder: Cylinder, force: float) -> tuple[float, float]:
        """Head and rod pressure [Pa] at a force [N]: one side is open to the tank."""
        assert self._supply is not None
        back, head, rod = self._supply.return_pressure, cylinder.head_area, cylinder.rod_area
        if force + back * rod >= back * head:
            return (force + back * rod) / head, back
        return back, (back * head - force) / rod

    @staticmethod
    def _cushioned(cylinder: Cylinder, length: float, speed: float) -> float:
        """Part of the full speed that the cushions let through."""
        linkage = cylinder.linkage
        room = linkage.longest - length if speed > 0.0 else length - linkage.shortest
        return min(1.0, _CREEP + (1.0 - _CREEP) * max(room, 0.0) / cylinder.cushion)

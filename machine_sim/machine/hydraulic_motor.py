"""Hydraulic motors with a reduction gear: of a joint, such as the swing, and of the tracks.

The relief valve of the motor limits the torque that accelerates the joint. With the lever in
neutral both ports are closed: the motor becomes a pump against the brake relief valve, so that an
upper structure with a large inertia runs on before it stops. Both valves open gradually
("shockless" relief valves): the torque rises to its maximum within `pressure_rise_time`. At rest
the closed ports and the parking brake hold the joint.

A travel motor has two displacements. It runs at the small one, fast, until the pressure reaches the
relief pressure; a larger force increases its displacement, at a lower speed for the same flow.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["HydraulicMotor", "TravelMotor"]


@dataclass(frozen=True)
class HydraulicMotor:
    """A motor that drives one joint.

    Attributes:
        displacement: volume of oil that one radian of the joint takes [m^3/rad], which is the
            displacement of the motor times the ratio of its gear.
        relief_pressure: maximum pressure that drives the joint [Pa].
        brake_relief_pressure: pressure at which the closed ports of a turning motor yield [Pa].
        pressure_rise_time: time in which the relief valves reach their pressure [s].
        holding_torque: torque of the parking brake, which holds the joint at rest [N m].
    """

    displacement: float
    relief_pressure: float
    brake_relief_pressure: float
    pressure_rise_time: float
    holding_torque: float

    def max_torque(self, back_pressure: float) -> float:
        """Return the maximum torque that drives the joint [N m]; `back_pressure` in [Pa]."""
        return self.displacement * (self.relief_pressure - back_pressure)


@dataclass(frozen=True)
class TravelMotor:
    """Motor of one track.

    Attributes:
        relief_pressure: maximum pressure [Pa].
        min_displacement: volume of oil that one metre of the belt takes at high speed [m^3/m].
    """

    relief_pressure: float
    min_displacement: float

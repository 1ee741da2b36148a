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

_REVERSAL_RATE = 0.02
"""Difference between demanded and actual speed above which a motor reverses its torque [rad/s];
below it the pressure follows the load without a drop."""


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

    def pressure(self, torque: float, back_pressure: float) -> float:
        """Return the pressure on the driving side [Pa] at a torque [N m]."""
        return back_pressure + abs(torque) / self.displacement

    def moving_torque_limit(
        self, dt: float, rate: float, target_rate: float, torque: float, back_pressure: float
    ) -> float:
        """Return the maximum torque of a turning motor in the next step [N m].

        Args:
            dt: time step [s].
            rate: joint speed [rad/s].
            target_rate: joint speed that the valve demands [rad/s]; zero with closed ports.
            torque: torque of the last step [N m].
            back_pressure: pressure in the line to the tank [Pa].
        """
        change = target_rate - rate
        is_braking = change * rate < 0.0
        pressure = self.brake_relief_pressure if is_braking else self.relief_pressure
        full = self.displacement * (pressure - back_pressure)
        rise = full * dt / self.pressure_rise_time
        # Only one side of the motor has pressure; that on the other side builds up from zero.
        is_reversing = torque * change < 0.0 and abs(change) > _REVERSAL_RATE
        built_up = 0.0 if is_reversing else abs(torque)
        return min(full, built_up + rise)


@dataclass(frozen=True)
class TravelMotor:
    """Motor of one track.

    Attributes:
        relief_pressure: maximum pressure [Pa].
        min_displacement: volume of oil that one metre of the belt takes at high speed [m^3/m].
    """

    relief_pressure: float
    min_displacement: float

    def displacement(self, force: float, back_pressure: float) -> float:
        """Return the displacement [m^3/m] at a drive force [N]."""
        return max(self.min_displacement, abs(force) / (self.relief_pressure - back_pressure))

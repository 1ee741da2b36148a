"""Hydraulic supply: the engine and the pumps that all cylinders and hydraulic motors share."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["HydraulicSupply", "Pump"]


@dataclass(frozen=True)
class HydraulicSupply:
    """Engine, pumps and valves.

    Attributes:
        main_relief_pressure: maximum pressure on the pump side [Pa].
        port_relief_pressure: pressure at which a locked cylinder yields [Pa].
        return_pressure: pressure in the line to the tank [Pa].
        pump_flow: maximum flow of all pumps together, at the speed of the engine without load
            [m^3/s].
        pump_power: maximum power of all pumps together [W].
        engine_power: rated power of the engine [W].
        engine_droop: decrease of the engine speed from no load to rated power, as a fraction.
        engine_response_time: time constant of the engine speed [s].
        valve_dead_band: command below which a valve stays closed, as a fraction of full speed.
        valve_delay: time from a command to the motion of the valve [s].
        valve_opening_time: time in which a valve opens or closes fully [s].
    """

    main_relief_pressure: float
    port_relief_pressure: float
    return_pressure: float
    pump_flow: float
    pump_power: float
    engine_power: float
    engine_droop: float
    engine_response_time: float
    valve_dead_band: float
    valve_delay: float
    valve_opening_time: float


class Pump:
    """The pumps, driven by an engine whose speed decreases under load.

    Attributes:
        engine_speed: speed of the engine over that without load.
    """

    def __init__(self, supply: HydraulicSupply) -> None:
        """
        Args:
            supply: engine and pumps.
        """
        self._supply = supply
        self.engine_speed = 1.0

    def max_flow(self, pressure: float) -> float:
        """Return the maximum flow [m^3/s] at a pressure [Pa]; pump power limits it."""
        supply = self._supply
        return min(supply.pump_flow * self.engine_speed, supply.pump_power / pressure)

    def advance(self, dt: float, power: float) -> None:
        """Advance the engine speed by `dt` [s] at a hydraulic power [W]."""
        supply = self._supply
        load = min(power / supply.engine_power, 1.0)
        change = 1.0 - supply.engine_droop * load - self.engine_speed
        self.engine_speed += change * min(dt / supply.engine_response_time, 1.0)

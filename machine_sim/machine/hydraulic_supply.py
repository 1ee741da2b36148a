"""Hydraulic supply: the engine and the pumps that all cylinders and hydraulic motors share."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["HydraulicSupply"]


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

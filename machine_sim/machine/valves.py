"""Control valves between the levers and the hydraulic actuators: dead band, delay, opening time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from machine_sim.machine.hydraulic_supply import HydraulicSupply

__all__ = ["Valves"]

_TIME_TOLERANCE = 1e-9
"""Tolerance in the comparison of times [s]: sums of time steps are not exact."""


class Valves:
    """One valve for each hydraulic actuator; commands of other actuators pass unchanged.

    A valve that is open demands the commanded speed: its dead band only suppresses small commands.

    Attributes:
        demand: speeds that the valves demand, in the units of the commands.
    """

    def __init__(
        self,
        supply: HydraulicSupply | None,
        max_speeds: Sequence[float],
        is_hydraulic: Sequence[bool],
    ) -> None:
        """
        Args:
            supply: response of the valves; None only without hydraulic actuators.
            max_speeds: maximum speed of each actuator.
            is_hydraulic: whether a valve controls the actuator.
        """
        self.demand = [0.0] * len(max_speeds)
        self._supply = supply
        self._max_speeds = list(max_speeds)
        self._is_hydraulic = list(is_hydraulic)
        self._time = 0.0
        self._last_command = [0.0] * len(max_speeds)
        self._arrived = self._last_command  # newest command that has reached the valves
        self._underway: deque[tuple[float, list[float]]] = deque()  # times of arrival, commands

    def advance(self, dt: float, commands: list[float]) -> None:
        """Advance the valves by `dt` [s] toward the commanded speeds."""
        supply = self._supply
        if supply is None:
            self.demand = list(commands)
            return
        if commands != self._last_command:
            self._last_command = list(commands)
            self._underway.append((self._time + supply.valve_delay, self._last_command))
        while self._underway and self._underway[0][0] <= self._time + _TIME_TOLERANCE:
            _, self._arrived = self._underway.popleft()
        self._time += dt
        for i, (command, maximum) in enumerate(zip(commands, self._max_speeds, strict=True)):
            if not self._is_hydraulic[i]:
                self.demand[i] = command
                continue
            target = self._arrived[i]
            if abs(target) < supply.valve_dead_band * maximum:
                target = 0.0
            step = maximum * dt / supply.valve_opening_time
            self.demand[i] += min(max(target - self.demand[i], -step), step)

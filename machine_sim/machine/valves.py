"""Control valves between the levers and the hydraulic actuators: dead band, delay, opening time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.hydraulic_supply import HydraulicSupply
from msg_bridge.kernels import helper, kernel

__all__ = ["DEMAND", "Valves", "advance_valves"]

COMMAND, ARRIVED, DEMAND = range(3)
"""Rows of the table of valves: the present command, the newest command that has reached the valve,
and the speed that the valve demands."""

DEAD_BAND, MAX_SPEED, OPENING_TIME, IS_HYDRAULIC = range(3, 7)
"""Rows of the table of valves: speed below which the valve stays closed, maximum speed, time in
which it opens fully [s], and 1.0 where a valve controls the actuator."""

_NUM_SLOTS = 7

_TIME_TOLERANCE = 1e-9
"""Tolerance in the comparison of times [s]: sums of time steps are not exact."""


class Valves:
    """One valve for each hydraulic actuator; commands of other actuators pass unchanged.

    A valve that is open demands the commanded speed: its dead band only suppresses small commands.

    Attributes:
        table: one row for each of the slots above, one column for each actuator.
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
        self.table: NDArray[np.float64] = np.zeros((_NUM_SLOTS, len(max_speeds)))
        self._delay = 0.0
        if supply is not None:
            self._delay = supply.valve_delay
            self.table[DEAD_BAND] = supply.valve_dead_band * np.array(max_speeds)
            self.table[MAX_SPEED] = max_speeds
            self.table[OPENING_TIME] = supply.valve_opening_time
            self.table[IS_HYDRAULIC] = is_hydraulic
        self._time = 0.0
        self._last_command = [0.0] * len(max_speeds)
        self._underway: deque[tuple[float, list[float]]] = deque()  # times of arrival, commands

    @property
    def demand(self) -> list[float]:
        """Speeds that the valves demand, in the units of the commands."""
        speeds: list[float] = self.table[DEMAND].tolist()
        return speeds

    def continue_from(self, other: Valves) -> None:
        """Take commands, underway ones included, and openings from valves of the same actuators."""
        for slot in (COMMAND, ARRIVED, DEMAND):
            self.table[slot] = other.table[slot]
        self._time, self._last_command = other._time, list(other._last_command)
        self._underway = deque(other._underway)

    def transmit(self, dt: float, commands: list[float]) -> None:
        """Transmit the commanded speeds to the valves for `dt` [s]; `advance_valves` follows."""
        if commands != self._last_command:
            self._last_command = list(commands)
            self.table[COMMAND] = commands
            self._underway.append((self._time + self._delay, self._last_command))
        while self._underway and self._underway[0][0] <= self._time + _TIME_TOLERANCE:
            _, self.table[ARRIVED] = self._underway.popleft()
        self._time += dt

    def advance(self, dt: float, commands: list[float]) -> None:
        """Advance the valves by `dt` [s] toward the commanded speeds."""
        self.transmit(dt, commands)
        _advance(dt, self.table)


@kernel
def _advance(dt, valves):  # type: ignore[no-untyped-def]
    """Run `advance_valves` alone."""
    advance_valves(dt, valves)


@helper
def advance_valves(dt, valves):  # type: ignore[no-untyped-def]
    """Open or close the valves for a time step.

    Args:
        dt: time step [s].
        valves: `Valves.table`; its demanded speeds are updated.
    """
    for i in range(valves.shape[1]):
        if not valves[IS_HYDRAULIC, i]:
            valves[DEMAND, i] = valves[COMMAND, i]
            continue
        target = valves[ARRIVED, i]
        if abs(target) < valves[DEAD_BAND, i]:
            target = 0.0
        step = valves[MAX_SPEED, i] * dt / valves[OPENING_TIME, i]
        valves[DEMAND, i] += min(max(target - valves[DEMAND, i], -step), step)

"""Diagnostics of the soil node: its run, its speed, and a second soil node on the same topics."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from msg_bridge.contract.rows import Rows
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.real_time_monitor import (
    OVERLOAD_CONDITION,
    LoadMeter,
    OverloadMonitor,
    TickLoad,
    overload_remedy,
)
from msg_bridge.nodes.sim_node import SimNode
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import SoilRun

__all__ = ["SoilDiagnostics"]

_FLOOR_CONDITION = "floor"
"""Name of the problem of columns without soil."""
_LOW_LOAD = 0.5
"""Load of the soil node below which it is not the reason of a slow clock."""


class SoilDiagnostics:
    """Fills the diagnostics of the soil node from its run."""

    def __init__(
        self,
        node: SimNode,
        diagnostics: Diagnostics,
        run: SoilRun,
        params: SoilNodeParams,
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            node: the soil node.
            diagnostics: diagnostics of the node, which this object fills before each publication.
            run: the run of the soil, which a reset begins again.
            params: parameters of the node; its tick period and mode do not change.
            now: monotonic wall clock [s].
        """
        self._now = now
        self._node, self._diagnostics, self._run, self._params = node, diagnostics, run, params
        self._load_meter = LoadMeter()
        self._monitor = OverloadMonitor(resolution=params.tick_period)
        self._num_starts = 0  # of the schedule, at the last update
        self._columns_at_floor: set[int] = set()  # flat numbers
        self._num_late_ticks = 0  # at the last update
        self._num_late_ticks_by_machine: Counter[int] = Counter()  # at the last update
        self._logged_level = Level.OK
        diagnostics.add_task(self._update)

    def start_run(self) -> None:
        """Measure the real-time factor from tick 0 of a new run."""
        self._monitor.restart()
        columns = self._run.endpoint.soil.columns
        self._columns_at_floor = set(np.flatnonzero(columns.height <= columns.floor).tolist())

    def record_tick(self, duration: float, map_updates: Rows) -> None:
        """Record a tick.

        Args:
            duration: wall time for which it was computed and published [s].
            map_updates: its MAP_UPDATE rows.
        """
        self._load_meter.record(duration)
        if map_updates.size:
            self._update_columns_at_floor(map_updates)

    def _update_columns_at_floor(self, map_updates: Rows) -> None:
        """Update the columns at the floor; comparing all would make a tick late."""
        columns = self._run.endpoint.soil.columns
        numbers = map_updates["row"].astype(np.int64) * columns.grid.cols + map_updates["col"]
        is_at_floor = columns.height.reshape(-1)[numbers] <= columns.floor
        if self._columns_at_floor or is_at_floor.any():
            self._columns_at_floor.difference_update(numbers[~is_at_floor].tolist())
            self._columns_at_floor.update(numbers[is_at_floor].tolist())

    def _update(self) -> None:
        load = self._load_meter.take(self._params.tick_period)
        self._measure_progress()
        num_late = self._run.scheduler.num_late_ticks - self._num_late_ticks
        for key, value in {**self._values(), **self._speed(load, num_late)}.items():
            self._diagnostics.set(key, value)
        self._report_overload(load, num_late)
        self._report_floor()
        self._num_late_ticks = self._run.scheduler.num_late_ticks
        self._num_late_ticks_by_machine = self._run.num_late_ticks_by_machine.copy()

    def _values(self) -> dict[str, Any]:
        """Return the diagnostics by key."""
        exchange = self._run.endpoint.exchange
        return {
            "tick": max(self._run.tick, 0),
            "run_id": exchange.run_id,
            "sync": self._params.sync,
            "paused": self._run.paused,
            "machines": ", ".join(map(str, exchange.joined)) or "none",
            "imbalance_mm3": exchange.ledger.imbalance if exchange.ledger else 0,
        }

    def _speed(self, load: TickLoad, num_late: int) -> dict[str, Any]:
        """Return the diagnostics of the clock by key; `num_late` ticks since the last update."""
        run = self._run
        return {
            "real_time_factor": f"{self._monitor.fraction:.3f}",
            "tick_load_mean": f"{load.mean:.3f}",
            "tick_load_max": f"{load.maximum:.3f}",
            "late_ticks": run.scheduler.num_late_ticks,
            "new_late_ticks": num_late,
            "max_delay_ms": f"{1e3 * run.scheduler.take_max_delay():.1f}",
            "late_ticks_by_machine": _format_counts(run.num_late_ticks_by_machine),
            "lost_time_s": f"{run.scheduler.lost_time:.2f}",
        }

    def _measure_progress(self) -> None:
        """Measure the real-time factor, and judge it unless time stood still on purpose."""
        now, scheduler = self._now(), self._run.scheduler
        is_paced = scheduler.is_running and scheduler.num_starts == self._num_starts
        self._num_starts = scheduler.num_starts
        sim_time = max(self._run.tick, 0) * self._params.tick_period
        self._monitor.update(now, sim_time, now, judge=is_paced)

    def _report_overload(self, load: TickLoad, num_late: int) -> None:
        """Set or clear the problem of a slow clock; log when it begins, once worsens, and ends."""
        level = self._monitor.level
        if level is Level.OK:
            self._diagnostics.clear(OVERLOAD_CONDITION)
            if self._logged_level is not Level.OK:
                self._node.get_logger().info("the clock runs in real time again")
            self._logged_level = Level.OK
        else:
            ledger = self._run.endpoint.exchange.ledger
            remedy = overload_remedy(has_particles=ledger is not None and ledger.particles > 0)
            text = (
                f"real-time factor {self._monitor.fraction:.2f}, below 1 for"
                f" {self._monitor.low_time:.0f} s: {self._cause(load, num_late)}; {remedy}"
            )
            self._diagnostics.problem(text, level, condition=OVERLOAD_CONDITION, is_persistent=True)
            if level > self._logged_level:
                self._node.get_logger().warning(text)
                self._logged_level = level

    def _report_floor(self) -> None:
        """Set or clear the problem of columns that are dug down to the floor of the terrain."""
        columns, num_empty = self._run.endpoint.soil.columns, len(self._columns_at_floor)
        self._diagnostics.set("columns_at_floor", num_empty)
        if num_empty == 0:
            self._diagnostics.clear(_FLOOR_CONDITION)
            return
        self._diagnostics.problem(
            f"{num_empty} columns are dug down to the floor of the terrain at"
            f" {columns.floor:.2f} m, which bears tools like rock; use a larger soil.soil_depth",
            condition=_FLOOR_CONDITION,
        )

    def _cause(self, load: TickLoad, num_late: int) -> str:
        """Return what the ticks since the last update waited for."""
        new = self._run.num_late_ticks_by_machine - self._num_late_ticks_by_machine
        late_now = self._run.endpoint.exchange.late if num_late == 0 else ()
        slow = sorted({machine for machine, n in new.items() if n > 0.5 * num_late}.union(late_now))
        if slow:
            return f"ticks wait for machine {', '.join(map(str, slow))}"
        if load.mean < _LOW_LOAD:
            return "other processes use the computer"
        return f"a tick of the soil takes {load.mean:.2f} of its period"


def _format_counts(counts: Counter[int]) -> str:
    """Return counts by machine id as a text."""
    return ", ".join(f"{machine}: {n}" for machine, n in sorted(counts.items())) or "none"

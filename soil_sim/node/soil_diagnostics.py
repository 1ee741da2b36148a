"""Diagnostics of the soil node: its run, its speed, and a second soil node on the same topics."""

from __future__ import annotations

import time
from typing import Any

from msg_bridge.contract import topics
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.sim_node import SimNode
from soil_sim.node.duplicate_soil_node import describe_duplicate
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import SoilRun

__all__ = ["SoilDiagnostics"]

_DUPLICATE_LOG_PERIOD = 60.0
"""Minimum wall time between two log lines on another soil node [s]."""


class SoilDiagnostics:
    """Fills the diagnostics of the soil node from its run."""

    def __init__(
        self, node: SimNode, diagnostics: Diagnostics, run: SoilRun, params: SoilNodeParams
    ) -> None:
        """
        Args:
            node: the soil node.
            diagnostics: diagnostics of the node, which this object fills before each publication.
            run: the run of the soil, which a reset begins again.
            params: parameters of the node; its tick period and mode do not change.
        """
        self._node, self._diagnostics, self._run, self._params = node, diagnostics, run, params
        self._last_tick, self._last_time = 0, time.monotonic()
        diagnostics.add_task(self._update)

    def start_run(self) -> None:
        """Measure the real-time factor from tick 0 of a new run."""
        self._last_tick, self._last_time = 0, time.monotonic()

    def _update(self) -> None:
        for key, value in self._values().items():
            self._diagnostics.set(key, value)
        if self._node.count_publishers(topics.SOIL_TICK) > 1:
            text = describe_duplicate(self._node)
            self._diagnostics.problem(text, Level.ERROR)
            self._node.get_logger().error(text, throttle_duration_sec=_DUPLICATE_LOG_PERIOD)

    def _values(self) -> dict[str, Any]:
        """Return the diagnostics by key."""
        exchange = self._run.endpoint.exchange
        return {
            "tick": max(self._run.tick, 0),
            "run_id": exchange.run_id,
            "sync": self._params.sync,
            "paused": self._run.paused,
            "real_time_factor": f"{self._measure_real_time_factor():.3f}",
            "late_ticks": self._run.scheduler.num_late_ticks,
            "reschedules": self._run.scheduler.num_reschedules,
            "machines": ", ".join(map(str, exchange.joined)) or "none",
            "imbalance_mm3": exchange.ledger.imbalance if exchange.ledger else 0,
        }

    def _measure_real_time_factor(self) -> float:
        """Return simulated over wall time since the last call."""
        now, tick = time.monotonic(), max(self._run.tick, 0)
        simulated = (tick - self._last_tick) * self._params.tick_period
        elapsed = now - self._last_time
        self._last_tick, self._last_time = tick, now
        return simulated / max(elapsed, 1e-9)

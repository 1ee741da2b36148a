"""Diagnostics of a machine node: its run, its particles, and the condition of each machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_run import MachineRun
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.nodes.diagnostics import Diagnostics

__all__ = ["MachineDiagnostics"]


class MachineDiagnostics:
    """Fills the diagnostics of a node from its run.

    Attributes:
        run: the present run; None until there is one.
    """

    def __init__(self, diagnostics: Diagnostics, instances: Sequence[MachineInstance]) -> None:
        """
        Args:
            diagnostics: diagnostics of the node, which this object fills before each publication.
            instances: machines of the node.
        """
        self.run: MachineRun | None = None
        self._diagnostics, self._instances = diagnostics, instances
        self._max_tick_duration = 0.0
        diagnostics.add_task(self._update)

    def record_tick(self, duration: float) -> None:
        """Record the wall time of a tick [s]."""
        self._max_tick_duration = max(self._max_tick_duration, duration)

    def _update(self) -> None:
        run = self.run
        if run is None:
            self._diagnostics.set("join_state", "waiting for the soil")
            return
        for key, value in self._values(run).items():
            self._diagnostics.set(key, value)
        self._max_tick_duration = 0.0
        pairs = zip(self._instances, run.sim.simulated_machines, strict=True)
        overturned = [
            instance.name or "the machine"
            for instance, simulated in pairs
            if simulated.machine.overturned
        ]
        if overturned:
            self._diagnostics.problem(
                f"overturned: {', '.join(overturned)}; start a new run with sim/reset"
            )
        elif run.endpoint.exchange.joined:
            self._diagnostics.clear()

    def _values(self, run: MachineRun) -> dict[str, Any]:
        """Return the diagnostics of node and machines by key."""
        particles = run.sim.particles
        values: dict[str, Any] = {
            "join_state": run.endpoint.exchange.join_state.value,
            "tick": run.tick,
            "particles": particles.count,
            "pending_mm3": run.sim.pending_mm3,
            "tunnelled": particles.num_plate_tunnellings + particles.num_ground_tunnellings,
            "slowest_tick_ms": f"{1e3 * self._max_tick_duration:.2f}",
        }
        for instance, simulated in zip(self._instances, run.sim.simulated_machines, strict=True):
            values |= _machine_values(instance, simulated)
        return values


def _machine_values(instance: MachineInstance, simulated: SimulatedMachine) -> dict[str, Any]:
    """Return the diagnostics of one machine, by key with the machine's prefix."""
    values = {
        "payload_fill": f"{simulated.payload.fill:.3f}",
        "emergency_stop": instance.arbiter.is_stopped,
        "tilt_rad": f"{simulated.machine.tilt:.3f}",
        "overturned": simulated.machine.overturned,
    }
    return {instance.topic_prefix + key: value for key, value in values.items()}

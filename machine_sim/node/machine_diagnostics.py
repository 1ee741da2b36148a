"""Diagnostics of a machine node: its run, its particles, and the condition of each machine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_run import MachineRun
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.contract import topics
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.real_time_monitor import (
    OVERLOAD_CONDITION,
    LoadMeter,
    OverloadMonitor,
    TickLoad,
    overload_remedy,
)

__all__ = ["MachineDiagnostics"]

_TRACK_CONDITION = "tracks"
"""Condition of a machine whose track has come off its wheels."""

_JOYSTICK_CONDITION = "joystick"
"""Condition of axes of a joystick that have not been at rest."""

_CONTACT_CONDITION = "contacts"
"""Condition of machines that touch each other."""

_PENDING_CONDITION = "pending soil"
"""Condition of soil that becomes particles too slowly."""

_EDGE_CONDITION = "edge of the map"
"""Condition of machines that are beyond the edge of the map."""

_MAX_RELEASE_TIME = 1.0
"""Time in which all pending soil can become particles, beyond which it is reported [s]."""

_TRACK_WARN_TIME = 10.0
"""Time for which a track that has come off is reported [s]."""


class MachineDiagnostics:
    """Fills the diagnostics of a node from its run.

    Attributes:
        run: the present run; None until there is one.
    """

    def __init__(
        self,
        diagnostics: Diagnostics,
        instances: Sequence[MachineInstance],
        *,
        bins: Sequence[str] = (),
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            diagnostics: diagnostics of the node, which this object fills before each publication.
            instances: machines of the node.
            bins: names of the bins of the node.
            now: monotonic wall clock [s].
        """
        self._names = (*(each.name or each.spec.name for each in instances), *bins)
        self._now = now
        self.run: MachineRun | None = None
        self._diagnostics, self._instances = diagnostics, instances
        self._load_meter = LoadMeter()
        self._speed = OverloadMonitor(resolution=0.0)  # ticks over their computing time
        self._coverage = OverloadMonitor(resolution=1.0)  # ticks made over ticks passed
        self._real_time_factor = OverloadMonitor(resolution=0.0)
        self._computing_time = 0.0  # of all ticks [s]
        self._num_reseats = 0
        self._reseated_at = -math.inf
        diagnostics.add_task(self._update)

    def start_run(self, run: MachineRun) -> None:
        """Measure a new run from now on."""
        self.run = run
        self._num_reseats = 0
        for monitor in (self._speed, self._coverage, self._real_time_factor):
            monitor.restart()

    def record_tick(self, duration: float) -> None:
        """Record the wall time for which a tick was computed and published [s]."""
        self._load_meter.record(duration)
        self._computing_time += duration

    def _update(self) -> None:
        run = self.run
        if run is None:
            self._diagnostics.set("join_state", "waiting for the soil")
            return
        load = self._load_meter.take(run.facts.tick_period)
        self._measure(run)
        for key, value in {**self._values(run), **self._speed_values(run, load)}.items():
            self._diagnostics.set(key, value)
        self._report_overload(run, load)
        self._report_reseats(run)
        self._report_joysticks()
        self._report_contacts(run)
        self._report_pending_soil(run)
        self._report_edge(run)
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

    def _report_pending_soil(self, run: MachineRun) -> None:
        """Report soil that becomes particles too slowly: until then it has no weight in a tool."""
        sim = run.sim
        per_tick = sim.params.max_releases_per_tick * sim.particles.params.nominal_volume
        per_second = per_tick / run.facts.tick_period
        if sim.pending_mm3 <= per_second * _MAX_RELEASE_TIME:
            self._diagnostics.clear(_PENDING_CONDITION)
            return
        self._diagnostics.problem(
            f"{1e-9 * sim.pending_mm3:.3f} m3 of excavated soil wait to become particles, of which"
            f" {1e-9 * per_second:.2g} m3 a second are made at most, and are no payload until then:"
            " increase particles.nominal_volume or stepping.max_releases_per_tick",
            condition=_PENDING_CONDITION,
        )

    def _values(self, run: MachineRun) -> dict[str, Any]:
        """Return the diagnostics of node and machines by key."""
        particles = run.sim.particles
        values: dict[str, Any] = {
            "join_state": run.endpoint.exchange.join_state.value,
            "tick": run.tick,
            "particles": particles.count,
            "pending_mm3": run.sim.pending_mm3,
            "tunnelled": particles.num_plate_tunnellings + particles.num_ground_tunnellings,
        }
        for instance, simulated in zip(self._instances, run.sim.simulated_machines, strict=True):
            values |= _machine_values(instance, simulated)
        return values

    def _measure(self, run: MachineRun) -> None:
        """Compare ticks with computing time, with the ticks that passed, and with wall time."""
        now, period = self._now(), run.facts.tick_period
        made, passed = run.progress
        judge = run.facts.realtime
        self._speed.update(now, made * period, self._computing_time, judge=judge)
        self._coverage.update(now, made, passed, judge=judge)
        self._real_time_factor.update(now, passed * period, now, judge=False)

    def _speed_values(self, run: MachineRun, load: TickLoad) -> dict[str, Any]:
        """Return the diagnostics of computing time and ticks by key."""
        made, passed = run.progress
        return {
            "real_time_factor": f"{self._real_time_factor.fraction:.3f}",
            "tick_load_mean": f"{load.mean:.3f}",
            "tick_load_max": f"{load.maximum:.3f}",
            "skipped_ticks": passed - made,
        }

    def _report_reseats(self, run: MachineRun) -> None:
        """Set or clear the problem of a track that has come off its wheels."""
        counts = [sum(m.machine.tracks.num_reseats) for m in run.sim.simulated_machines]
        if sum(counts) > self._num_reseats:
            self._num_reseats, self._reseated_at = sum(counts), self._now()
        if self._now() - self._reseated_at > _TRACK_WARN_TIME:
            self._diagnostics.clear(_TRACK_CONDITION)
            return
        self._diagnostics.problem(
            "a track has come off its wheels and was put back; drive more gently, or use"
            " stepping.track_model: kinematic",
            condition=_TRACK_CONDITION,
        )

    def _report_joysticks(self) -> None:
        """Set or clear the problem of axes that do not count, since they have not been at rest."""
        texts = [
            f"{', '.join(axes)} of {instance.topic_prefix}{topics.JOY}"
            for instance in self._instances
            if (axes := instance.arbiter.ignored_joystick_axes)
        ]
        if not texts:
            self._diagnostics.clear(_JOYSTICK_CONDITION)
            return
        self._diagnostics.problem(
            f"ignored until at rest once: {'; '.join(texts)}; release the levers and pedals, or set"
            " the joy_ parameters to the axes of the device",
            condition=_JOYSTICK_CONDITION,
        )

    def _report_contacts(self, run: MachineRun) -> None:
        """Set or clear the problem of machines that touch, or have touched since the last time."""
        self._diagnostics.set("contacts", run.sim.contacts.num_contacts)
        contacts = run.sim.contacts.take_recent()
        if not contacts:
            self._diagnostics.clear(_CONTACT_CONDITION)
            return
        texts = []
        for contact in contacts:
            first, second = (self._names[k] for k in contact.pair)
            x, y, z = contact.position
            verb = "touched" if contact.is_over else "touch"
            texts.append(
                f"{first} and {second} {verb} with up to {contact.max_force / 1e3:.0f} kN at"
                f" ({x:.1f}, {y:.1f}, {z:.1f}) m"
            )
        self._diagnostics.problem("; ".join(texts), Level.WARN, condition=_CONTACT_CONDITION)

    def _report_edge(self, run: MachineRun) -> None:
        """Set or clear the problem of machines and tools beyond the edge of the map."""
        parts = []
        for instance, simulated in zip(self._instances, run.sim.simulated_machines, strict=True):
            name = instance.name or "the machine"
            parts += [f"{part} of {name}" for part in simulated.parts_beyond_map]
        if not parts:
            self._diagnostics.clear(_EDGE_CONDITION)
            return
        self._diagnostics.problem(
            f"beyond the edge of the map: {', '.join(parts)}; there tracks stand on ground"
            " that continues at the height of the edge, tools meet no soil, and soil that lands"
            " leaves the run; move back, or start a run on a larger site",
            condition=_EDGE_CONDITION,
        )

    def _report_overload(self, run: MachineRun, load: TickLoad) -> None:
        """Set or clear the problem of a node that is too slow for real time."""
        level = max(self._speed.level, self._coverage.level)
        if level is Level.OK:
            self._diagnostics.clear(OVERLOAD_CONDITION)
            return
        causes = []
        if self._speed.level is not Level.OK:
            causes.append(f"a tick takes {load.mean:.2f} of its period")
        if self._coverage.level is not Level.OK:
            fraction = self._coverage.fraction
            causes.append(f"the machine makes {fraction:.0%} of the ticks and skips the others")
        remedy = overload_remedy(has_particles=run.sim.particles.count > 0)
        text = f"too slow for real time: {' and '.join(causes)}; {remedy}"
        self._diagnostics.problem(text, level, condition=OVERLOAD_CONDITION, is_persistent=True)


def _machine_values(instance: MachineInstance, simulated: SimulatedMachine) -> dict[str, Any]:
    """Return the diagnostics of one machine, by key with the machine's prefix."""
    values = {
        "payload_fill": f"{simulated.payload.fill:.3f}",
        "emergency_stop": instance.arbiter.is_stopped,
        "ignored_axes": ", ".join(instance.arbiter.ignored_joystick_axes),
        "tracks_off_wheels": sum(simulated.machine.tracks.num_reseats),
        "tilt_rad": f"{simulated.machine.tilt:.3f}",
        "overturned": simulated.machine.overturned,
        "beyond_map": ", ".join(simulated.parts_beyond_map),
    }
    return {instance.topic_prefix + key: value for key, value in values.items()}

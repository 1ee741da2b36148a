"""Scene: everything that a page shows, with the newest state of each part.

A source (`viewer.sources`) sets it in one thread, and the server encodes it in another: both hold
`Scene.lock`. Each part has a version that increases with each change, so that a client gets what
it lacks.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.rows import Rows
from viewer.scene.machine_view import MachineView
from viewer.scene.terrain_surface import TerrainSurface

__all__ = ["Scene", "SoilColor"]

_RATE_TIME = 2.0
"""Wall time over which the real-time factor is averaged [s]."""


class SoilColor(NamedTuple):
    """A soil type on the page.

    Attributes:
        name: its name.
        color: of dry soil: red, green, blue, each 0 to 1.
    """

    name: str
    color: tuple[float, float, float]


_DEFAULT_SOILS = (SoilColor("", (0.55, 0.42, 0.3)),)


class Scene:
    """What is shown.

    Attributes:
        lock: held by whoever reads or changes the scene.
        terrain: the surface.
        soils: soil types by id.
        machines: machines by namespace.
        clouds: PARTICLE rows by the namespace of their machine node.
        tick: last tick; -1 before the first.
        time: simulation time at the end of `tick` [s]; 0 before the first.
        is_paused: whether simulated time stands still.
        ledger: the ledger of `tick`; None before the first.
        status: conditions of the nodes and what is waited for, by name.
        is_restoring: whether the state is incomplete, because another time is sought.
        version: increases with each change of anything.
        soils_version, machines_version, particles_version: the same of these parts.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            now: a monotonic wall clock [s].
        """
        self.lock = threading.Lock()
        self.terrain = TerrainSurface()
        self.soils: tuple[SoilColor, ...] = _DEFAULT_SOILS
        self.machines: dict[str, MachineView] = {}
        self.clouds: dict[str, Rows] = {}
        self.tick = -1
        self.time = 0.0
        self.is_paused = False
        self.ledger: Ledger | None = None
        self.status: dict[str, str | float | bool] = {}
        self.is_restoring = False
        self.version = 0
        self.soils_version = self.machines_version = self.particles_version = 0
        self._num_model_changes = 0
        self._stops: dict[str, bool] = {}  # by machine, also those that are not shown yet
        self._denied_stops: set[str] = set()  # machines that reported a release since a request
        self._now = now
        self._condition_times: dict[str, float] = {}  # wall time of the last report, by name
        self._ticks: deque[tuple[float, float]] = deque()  # wall time, simulation time

    @property
    def run_id(self) -> int:
        """Number of the run; 0 before it is known."""
        return self.terrain.run_id or 0

    @property
    def known_time(self) -> float | None:
        """Simulation time of what is shown [s]; None: not known.

        Before the first tick, as at the beginning of a recording that began during a run, it is the
        newest time of a machine.
        """
        if self.ledger is not None:
            return self.time
        return max((view.time for view in self.machines.values() if view.joints), default=None)

    @property
    def real_time_factor(self) -> float:
        """Simulated time over wall time of the last seconds; 0 while time stands still."""
        while self._ticks and self._now() - self._ticks[0][0] > _RATE_TIME:
            self._ticks.popleft()
        if len(self._ticks) < 2:
            return 0.0
        elapsed = self._now() - self._ticks[0][0]
        return (self._ticks[-1][1] - self._ticks[0][1]) / max(elapsed, 1e-3)

    def start_run(self, run_id: int) -> None:
        """Show another run: no state of the one before remains."""
        is_other = run_id != self.terrain.run_id
        self.terrain.start_run(run_id)
        if is_other:
            self.discard_run()

    def discard_run(self) -> None:
        """Discard the state of machines, particles and accounts."""
        for machine in self.machines.values():
            machine.start_run()
        self.clouds.clear()
        self.tick, self.time, self.ledger = -1, 0.0, None
        self._ticks.clear()
        self.machines_changed()
        self.particles_changed()

    def set_condition(self, name: str, text: str) -> None:
        """Set the condition that a node reports: `OK`, or level and text."""
        self.status[name] = text
        self._condition_times[name] = self._now()
        self.version += 1

    def remove_old_conditions(self, max_age: float) -> None:
        """Remove the conditions of nodes that have reported nothing for a wall time [s]."""
        now = self._now()
        for name, time_reported in list(self._condition_times.items()):
            if now - time_reported > max_age:
                del self._condition_times[name]
                self.status.pop(name, None)
                self.version += 1

    def begin_restore(self) -> None:
        """Discard the state, until `end_restore`; no frame is sent in between."""
        self.is_restoring = True
        self.status.clear()
        self._condition_times.clear()
        self._stops.clear()
        self._denied_stops.clear()
        for machine in self.machines.values():
            machine.is_stopped, machine.is_stop_requested = None, False
        self.discard_run()

    def end_restore(self) -> None:
        """Show the restored state."""
        self.is_restoring = False
        self.version += 1

    def set_tick(self, ledger: Ledger) -> None:
        """Set the end of a tick, with its ledger."""
        self.tick, self.ledger = ledger.tick, ledger
        self.time = ledger.stamp_sec + 1e-9 * ledger.stamp_nanosec
        self._ticks.append((self._now(), self.time))
        self.version += 1

    def set_soils(self, soils: tuple[SoilColor, ...]) -> None:
        """Set the soil types."""
        if soils and soils != self.soils:
            self.soils = soils
            self.soils_version += 1
            self.version += 1

    def set_particles(self, namespace: str, rows: Rows) -> None:
        """Set the particles of a machine node, PARTICLE rows."""
        self.clouds[namespace] = rows
        self.particles_changed()

    def machine(self, namespace: str) -> MachineView:
        """Return the machine of a namespace, which is added if it is new."""
        if namespace not in self.machines:
            stopped = self._stops.get(namespace)
            self.machines[namespace] = MachineView(namespace, is_stopped=stopped)
            self.machines_changed()
        return self.machines[namespace]

    def model_changed(self, machine: MachineView) -> None:
        """Count a change of what a machine is: model, levers or pattern."""
        self._num_model_changes += 1
        machine.model_version = self._num_model_changes
        self.machines_changed()

    def remove_machine(self, namespace: str) -> None:
        """Remove a machine that has gone."""
        self._stops.pop(namespace, None)
        self._denied_stops.discard(namespace)
        if self.machines.pop(namespace, None) is not None:
            self.machines_changed()

    def set_stop(self, namespace: str, is_stopped: bool) -> None:
        """Set the emergency stop that a machine reports; the machine need not be shown yet.

        A request remains after one report of a released stop, which may have been sent before the
        press was received, and not after the second.
        """
        self._stops[namespace] = is_stopped
        view = self.machines.get(namespace)
        if view is None:
            return
        if view.is_stop_requested:
            if is_stopped or namespace in self._denied_stops:
                self.request_stop(namespace, False)
            else:
                self._denied_stops.add(namespace)
        if view.is_stopped is not is_stopped:
            view.is_stopped = is_stopped
            self.machines_changed()

    def request_stop(self, namespace: str, is_pressed: bool) -> None:
        """Set whether a press of the emergency stop was published that no report confirms yet."""
        self._denied_stops.discard(namespace)
        view = self.machines.get(namespace)
        if view is None:
            return
        is_requested = is_pressed and view.is_stopped is not True
        if view.is_stop_requested is not is_requested:
            view.is_stop_requested = is_requested
            self.machines_changed()

    def remove_particles(self, namespace: str) -> None:
        """Remove the particles of a machine node that has gone."""
        if self.clouds.pop(namespace, None) is not None:
            self.particles_changed()

    def machines_changed(self) -> None:
        """Count a change of machines."""
        self.machines_version += 1
        self.version += 1

    def particles_changed(self) -> None:
        """Count a change of particles."""
        self.particles_version += 1
        self.version += 1

    def terrain_changed(self) -> None:
        """Count a change of the terrain."""
        self.version += 1

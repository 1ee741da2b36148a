"""OperatedWorld: a world of one process whose machines are commanded, and what a viewer shows."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dig_operator import Command, Observation
from earthmoving_sim.figures.world_scene import WorldScene
from earthmoving_sim.operated_machine import MachineOperator, OperatedMachine
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineSpec, load_machine_spec
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement, SimulatedMachine
from machine_sim.simulation import MachineSim
from machine_sim.warm_up import warm_up as warm_up_machines
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.warm_up import warm_up as warm_up_soil
from viewer.scene.scene import Scene

__all__ = ["SOIL", "OperatedWorld", "Script", "load_spec"]

SOIL = SoilParams(repose_angle=35.0, swell=0.15)
"""Soil of the figures, unless stated: loam without cohesion, as in the demo."""

_PARTICLES = ParticleParams(nominal_volume=1_000_000)

_COMMAND_INTERVAL_TICKS = 2
_SHOW_INTERVAL = 0.1
"""Simulated time between two states that a viewer is given, for its smoke and dust [s]."""


def load_spec(name: str) -> MachineSpec:
    """Return a shipped machine by the name of its file."""
    return load_machine_spec(find_config(f"machines/{name}.yaml"))


class Script:
    """Commands a machine by velocities that depend on the time alone."""

    def __init__(self, spec: MachineSpec, rates: Callable[[float], dict[str, float]]) -> None:
        """
        Args:
            spec: the machine.
            rates: returns the velocities [rad/s] by joint at a time [s]; `left` and `right` are
                the speeds of the tracks [m/s]. What is not named stands still.
        """
        self._names, self._rates = spec.joint_names, rates

    def command(self, observation: Observation, dt: float) -> Command:
        """Return the velocities of the present time."""
        rates = self._rates(observation.time)
        joints = np.array([rates.get(name, 0.0) for name in self._names])
        return Command(joints, np.array([rates.get("left", 0.0), rates.get("right", 0.0)]))


class OperatedWorld:
    """Machines with operators on a site.

    Attributes:
        world: soil and machines.
        sim: the machines.
        view: sets the scene that a viewer shows.
        computing_time: CPU time of the simulation so far, without pictures [s].
        max_particles: maximum number of particles so far.
    """

    def __init__(
        self,
        grid: Grid,
        heights: NDArray[np.floating],
        machines: Sequence[tuple[MachineSpec, tuple[float, float], float]],
        *,
        soil: SoilParams = SOIL,
        kinds: NDArray[np.integer] | None = None,
        particles: ParticleParams | None = None,
        stepping: MachineSimParams | None = None,
    ) -> None:
        """
        Args:
            grid, heights: the site [m], shape (rows, cols).
            machines: machines with position [m] and heading [rad].
            soil: the soil.
            kinds: kind of each column by id, as for `Soil`.
            particles, stepping: parameters; shipped defaults if None.
        """
        stepping, particles = stepping or MachineSimParams(), particles or _PARTICLES
        warm_up_soil(soil)
        warm_up_machines([spec for spec, _, _ in machines], stepping, particles)
        terrain = Soil(grid, heights, soil, soil=kinds)
        self.sim = MachineSim(
            [Placement(spec, position, yaw) for spec, position, yaw in machines],
            grid,
            terrain.columns.height,
            params=stepping,
            particle_params=particles,
            soils=terrain.loose_soils,
            soil=terrain.columns.top_soil,
            moisture=terrain.columns.top_moisture,
        )
        self.world = World(terrain, {1: self.sim})
        self.computing_time, self.max_particles = 0.0, 0
        self._clock_start = 0.0
        self._tick_period = self.sim.params.tick_period
        self._operated: dict[int, OperatedMachine] = {}
        self._viewers: list[Callable[[], None]] = []
        self._last_shown = 0.0
        self.view = WorldScene(self.world, self._tick_period)

    @property
    def scene(self) -> Scene:
        """What a viewer shows."""
        return self.view.scene

    @property
    def time(self) -> float:
        """Simulation time [s]."""
        return self.world.tick * self._tick_period

    @property
    def real_time_factor(self) -> float:
        """Simulated over computing time since the start, or since `restart_clock`.

        It is the real-time factor on one core that does nothing else.
        """
        return (self.time - self._clock_start) / max(self.computing_time, 1e-9)

    def restart_clock(self) -> None:
        """Begin a new measurement of the real-time factor."""
        self.computing_time, self._clock_start = 0.0, self.time

    def machine(self, index: int = 0) -> SimulatedMachine:
        """Return a machine."""
        return self.sim.simulated_machines[index]

    def operate(self, operator: MachineOperator | None, index: int = 0) -> None:
        """Let an operator command a machine from now on; None: the machine holds its pose."""
        if operator is None:
            self._operated.pop(index, None)
            machine = self.machine(index).machine
            machine.command(np.zeros(len(machine.spec.joint_names)), np.zeros(2))
        else:
            self._operated[index] = OperatedMachine(
                self.world, self.machine(index), operator, self._tick_period
            )

    def on_show(self, show: Callable[[], None]) -> None:
        """Call `show` with the updated scene every tenth of a second of simulated time."""
        self._viewers.append(show)

    def run_for(self, duration: float) -> None:
        """Run for a simulated time [s]."""
        end = self.time + duration
        self.run_until(lambda: self.time >= end - 1e-9, duration + 1.0)

    def run_until(self, is_reached: Callable[[], bool], limit: float = 120.0) -> None:
        """Run until a condition holds.

        Args:
            is_reached: the condition.
            limit: maximum simulated time [s].

        Raises:
            EarthmovingError: it did not hold in time.
        """
        end = self.time + limit
        while not is_reached():
            if self.time > end:
                raise EarthmovingError(f"a scene was not reached within {limit:g} s")
            self._step()
            if self._viewers and self.time - self._last_shown >= _SHOW_INTERVAL - 1e-9:
                self.show()

    def show(self) -> None:
        """Update the scene, and let the viewers see it."""
        self._last_shown = self.time
        self.view.update()
        for viewer in self._viewers:
            viewer()

    def close(self) -> None:
        """Release the physics engine."""
        self.world.close()

    def _step(self) -> None:
        start = time.thread_time()
        for operated in self._operated.values():
            operated.observe_and_command(_COMMAND_INTERVAL_TICKS * self._tick_period)
        for _ in range(_COMMAND_INTERVAL_TICKS):
            self.world.step()
            self.view.count_travel()
        self.computing_time += time.thread_time() - start
        self.max_particles = max(self.max_particles, self.sim.particles.count)

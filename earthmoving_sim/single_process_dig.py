"""SingleProcessDig: the scripted operator digs in a world of one process, and its run is recorded.

The operator works as its node does: it observes the state every second tick, and its command takes
effect two ticks later. The same run with ROS nodes in lockstep ends in the same state.
"""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dig_operator import Command, DigTask, HaulTask, OperatorPhase
from earthmoving_sim.coloured_mesh import merge_meshes
from earthmoving_sim.demo_site import check_slope_stability, jacksboro_site
from earthmoving_sim.dig_outcome import PATH_INTERVAL_TICKS, DigOutcome
from earthmoving_sim.machine_mesh import machine_mesh
from earthmoving_sim.machine_outline import machine_outline
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.run_config import RunConfig
from earthmoving_sim.world import World
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from machine_sim.warm_up import warm_up as warm_up_machines
from msg_bridge.kernels import log_compilation
from soil_sim.soil import Soil
from soil_sim.terrain import HeightMap
from soil_sim.warm_up import warm_up as warm_up_soil

__all__ = ["COMMAND_DELAY_TICKS", "COMMAND_INTERVAL_TICKS", "SingleProcessDig"]

COMMAND_INTERVAL_TICKS = 2
"""Ticks between commands of the operator."""

COMMAND_DELAY_TICKS = 2
"""Ticks from an observation until the operator's command takes effect.

With nodes, soil and machine compute these ticks while the operator computes its command.
"""

_DIGGER = "/site/digger"
"""Name of the excavator for the operator of a truck."""

_PROGRESS_INTERVAL_TICKS = 100
"""Ticks between lines of progress."""

_LINE_WIDTH = 118
"""Width to which a line of progress is padded, so that it replaces the previous one."""


class _LipPoint(NamedTuple):
    """A point of the lip's path [m], shape (3,), with the cycle and the phase."""

    position: NDArray[np.float64]
    cycle: int
    phase: OperatorPhase


class SingleProcessDig:
    """An excavator with an operator on a site.

    Attributes:
        config: parameters of all parts.
        site: terrain before the run.
        machine: the simulated excavator.
        world: soil and machine.
        task: the operator's task.
        haul_task: task of the truck's operator; None without a truck.
    """

    def __init__(self, config: RunConfig, site: HeightMap | None = None) -> None:
        """
        Args:
            config: parameters of all parts.
            site: the terrain; the demo's site if None.

        Raises:
            TerrainError: the ground is too steep, or the machine would stand off the map.
        """
        self.config = config
        self.site = site or jacksboro_site()
        self._dt = config.stepping.tick_period
        check_slope_stability(self.site, config)
        soil = Soil(self.site.grid, self.site.heights, config.soil)
        start_x = config.run.start_x - config.task.approach_distance
        placements = [Placement(config.machine, (start_x, config.run.start_y))]
        if config.truck_machine is not None:
            truck = config.truck
            placements.append(
                Placement(config.truck_machine, (truck.x, truck.y), math.radians(truck.yaw))
            )
        self.machine = MachineSim(
            placements,
            self.site.grid,
            soil.columns.height,
            params=config.stepping,
            particle_params=config.particles,
            soils=soil.loose_soils,
            soil=soil.columns.top_soil,
            moisture=soil.columns.top_moisture,
            seed=config.run.seed,
        )
        with log_compilation(print):
            warm_up_soil(config.soil)
            machines = [placement.spec for placement in placements]
            warm_up_machines(machines, config.stepping, config.particles)
        self.world = World(soil, {1: self.machine})
        self.task = DigTask(config.machine, config.behaviour, config.task)
        self.haul_task: HaulTask | None = None
        excavator, *trucks = self.machine.simulated_machines
        self._operated_machine = OperatedMachine(
            self.world,
            excavator,
            self.task,
            self._dt,
            others={config.task.truck: trucks[0]} if trucks else {},
        )
        self._operated: list[tuple[OperatedMachine, DigTask | HaulTask]] = [
            (self._operated_machine, self.task)
        ]
        if config.truck_machine is not None:
            self.haul_task = HaulTask(config.truck_machine, config.haul)
            operated = OperatedMachine(
                self.world, trucks[0], self.haul_task, self._dt, others={_DIGGER: excavator}
            )
            self._operated.append((operated, self.haul_task))
        self._lip_path: list[_LipPoint] = []
        self._max_imbalance = 0
        self._max_particles = 0

    def run(self, *, progress: bool = False) -> DigOutcome:
        """Run until the task has ended.

        Args:
            progress: print a line of progress each simulated second.
        """
        start_time = time.perf_counter()
        pending: deque[tuple[int, list[Command]]] = deque()  # tick of effect, commands
        last_tick: int | None = None
        while self.world.tick != last_tick:
            tick = self.world.tick
            if tick % COMMAND_INTERVAL_TICKS == 0 and not self._is_finished:
                commands = [
                    task.command(operated.observation(), COMMAND_INTERVAL_TICKS * self._dt)
                    for operated, task in self._operated
                ]
                if self._is_finished:
                    last_tick = tick + COMMAND_DELAY_TICKS  # the ticks that nodes still do
                else:
                    pending.append((tick + COMMAND_DELAY_TICKS, commands))
            while pending and pending[0][0] <= tick:
                _, commands = pending.popleft()
                pairs = zip(self.machine.simulated_machines, commands, strict=True)
                for simulated, command in pairs:
                    simulated.machine.command(command.joints, command.tracks)
            self._step()
            if progress and self.world.tick % _PROGRESS_INTERVAL_TICKS == 0:
                self._print_progress(start_time)
        wall_time = time.perf_counter() - start_time
        if progress:
            self._print_progress(start_time)
            print()
        return self._outcome(wall_time)

    @property
    def _is_finished(self) -> bool:
        """Whether the last task has ended, or any has ended early."""
        tasks = [task for _, task in self._operated]
        return tasks[-1].done or any(task.done and task.abort_reason for task in tasks)

    def close(self) -> None:
        """Release the physics engine."""
        self.world.close()

    def _step(self) -> None:
        ledger = self.world.step()
        if abs(ledger.imbalance) > abs(self._max_imbalance):
            self._max_imbalance = ledger.imbalance
        self._max_particles = max(self._max_particles, self.machine.particles.count)
        if self.world.tick % PATH_INTERVAL_TICKS == 0:
            rotation, pin = self.machine.machine.tool.pose
            lip = rotation[:, 0] * self.machine.machine.spec.bucket.tip_radius + pin
            self._lip_path.append(_LipPoint(lip, self.task.cycle, self.task.phase))

    def _print_progress(self, start_time: float) -> None:
        simulated_time = self.world.tick * self._dt
        wall_time = time.perf_counter() - start_time
        ledger = self.world.ledger
        haul = self.haul_task
        total = "" if haul else f"/{self.config.task.cycles}"
        loads = "" if self.config.haul.duration else f"/{self.config.haul.loads}"
        truck = f" truck {haul.cycle}{loads} {haul.phase:<8}" if haul else ""
        line = (
            f"cycle {self.task.cycle}{total}"
            f"  {self.task.phase:<8}{truck}"
            f" bucket {100 * self.machine.payload.fill:3.0f} %"
            f"  particles {self.machine.particles.count:5d}"
            f"  in transit {(ledger.pending + ledger.particles) / 1e9:5.2f} m3"
            f"  imbalance {ledger.imbalance} mm3"
            f"  {simulated_time:5.1f} s  {simulated_time / max(wall_time, 1e-9):4.1f} x real time"
            f"{self._describe_waits()}"
        )
        if sys.stdout.isatty():
            print("\r" + line.ljust(_LINE_WIDTH), end="", flush=True)
        else:
            print(line, flush=True)

    def _describe_waits(self) -> str:
        """Return what the operators wait for; empty if neither waits."""
        tasks = {"excavator": self.task, "truck": self.haul_task}
        return "".join(
            f"  {name} waits for {task.wait_reason}"
            for name, task in tasks.items()
            if task is not None and task.wait_reason
        )

    def _outcome(self, wall_time: float) -> DigOutcome:
        columns = self.world.soil.columns
        particles, haul = self.machine.particles, self.haul_task
        observation = self._operated_machine.observation()
        meshes, outlines = [], []
        pairs = zip(self.machine.simulated_machines, self._operated, strict=True)
        for simulated, (operated, _) in pairs:
            seen = operated.observation()
            pose = (
                simulated.machine.spec,
                seen.base_position,
                seen.base_rotation,
                seen.joints,
            )
            meshes.append(machine_mesh(*pose, simulated.machine.tracks.shoe_poses))
            outlines += machine_outline(*pose)
        return DigOutcome(
            site=self.site,
            grid=self.site.grid,
            after=columns.height.copy(),
            loose_depth=columns.loose_depth,
            cycles=list(self.task.reports),
            ledger=self.world.ledger,
            max_imbalance=self._max_imbalance,
            moved_volume=sum(cycle.moved_volume for cycle in self.task.reports),
            simulated_time=self.world.tick * self._dt,
            wall_time=wall_time,
            max_particles=self._max_particles,
            tunnelled=particles.num_plate_tunnellings + particles.num_ground_tunnellings,
            abort_reason=self.task.abort_reason or (haul.abort_reason if haul else ""),
            loads=list(haul.reports) if haul else [],
            state_hash=self.world.state_hash(),
            state_tick=self.world.tick,
            run_mode="one process",
            lip_path=np.array([point.position for point in self._lip_path]).reshape(-1, 3),
            lip_cycle=np.array([point.cycle for point in self._lip_path], dtype=np.int64),
            lip_phase=np.array([point.phase.value for point in self._lip_path], dtype=np.str_),
            machine_mesh=merge_meshes(*meshes),
            machine_outline=outlines,
            machine_position=(
                float(observation.base_position[0]),
                float(observation.base_position[1]),
            ),
        )

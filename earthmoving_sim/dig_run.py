"""A run: the scripted operator digs in a world of one process, and all is written down."""

from __future__ import annotations

import sys
import time
from collections import deque

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.machine_shape import machine_faces, machine_outline
from earthmoving_sim.operated import Operated
from earthmoving_sim.outcome import PATH_EVERY, Outcome
from earthmoving_sim.run_config import RunConfig
from earthmoving_sim.site import jacksboro_site, refuse_landslide
from earthmoving_sim.world import World
from machine_sim.core import MachineSim
from machine_sim.operator import Command, Shift
from machine_sim.particles import warm_up
from machine_sim.work.rig import Placement
from soil_sim.soil import Soil
from soil_sim.terrain import HeightMap

__all__ = ["LOOK_EVERY", "REACTION", "DigRun"]

LOOK_EVERY = 2
"""Ticks between commands of the operator."""

REACTION = 2
"""Ticks from what the operator sees until its command counts.

As nodes, soil and machine go on while the operator thinks, and it still does the same run.
"""

_PROGRESS_EVERY = 100
"""Ticks between lines of progress."""


class DigRun:
    """An excavator on the demo's site with an operator at its levers.

    Attributes:
        world: soil and machine.
        operator: who works the levers.
    """

    def __init__(self, config: RunConfig, site: HeightMap | None = None) -> None:
        """
        Args:
            config: parameters of all parts.
            site: the terrain; the demo's own if not given.
        """
        self.config = config
        self.site = site or jacksboro_site()
        self._dt = config.stepping.tick
        refuse_landslide(self.site, config)
        soil = Soil(self.site.grid, self.site.heights, config.soil)
        start = config.run.start_x - config.shift.approach
        self.machine = MachineSim(
            [Placement(config.machine, (start, config.run.start_y))],
            self.site.grid,
            soil.columns.height,
            params=config.stepping,
            particle_params=config.particles,
            soils=soil.loose_soils,
            soil=soil.columns.top_soil,
            moisture=soil.columns.top_moisture,
            seed=config.run.seed,
        )
        warm_up(config.particles)
        self.world = World(soil, {1: self.machine})
        self.operator = Shift(config.machine, config.operator, config.shift)
        self._operated = Operated(self.world, self.machine.rigs[0], self.operator, self._dt)
        self._path: list[tuple[NDArray[np.float64], int, str]] = []
        self._worst = 0
        self._most = 0

    def run(self, *, progress: bool = False) -> Outcome:
        """Do the whole shift.

        Args:
            progress: print how it goes.
        """
        began = time.perf_counter()
        coming: deque[tuple[int, Command]] = deque()
        last: int | None = None
        while self.world.tick != last:
            if self.world.tick % LOOK_EVERY == 0 and not self.operator.done:
                command = self.operator.command(self._operated.view(), LOOK_EVERY * self._dt)
                if self.operator.done:
                    last = self.world.tick + REACTION  # for that long nobody waits for a command
                else:
                    coming.append((self.world.tick + REACTION, command))
            while coming and coming[0][0] <= self.world.tick:
                _, command = coming.popleft()
                self.machine.command(command.joints, command.tracks)
            self._step()
            if progress and self.world.tick % _PROGRESS_EVERY == 0:
                self._say(began)
        wall = time.perf_counter() - began
        if progress:
            self._say(began)
            print()
        return self._outcome(wall)

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def _step(self) -> None:
        ledger = self.world.step()
        if abs(ledger.imbalance) > abs(self._worst):
            self._worst = ledger.imbalance
        self._most = max(self._most, self.machine.particles.count)
        if self.world.tick % PATH_EVERY == 0:
            rotation, pin = self.machine.machine.tool.pose
            lip = rotation[:, 0] * self.machine.machine.description.bucket.tip_length + pin
            self._path.append((lip, self.operator.cycle, self.operator.phase))

    def _say(self, began: float) -> None:
        simulated = self.world.tick * self._dt
        wall = time.perf_counter() - began
        ledger = self.world.ledger
        line = (
            f"cycle {self.operator.cycle}/{self.config.shift.cycles}"
            f"  {self.operator.phase:<6}"
            f" bucket {100 * self.machine.payload.fill:3.0f} %"
            f"  particles {self.machine.particles.count:5d}"
            f"  in hand {(ledger.pending + ledger.particles) / 1e9:5.2f} m3"
            f"  imbalance {ledger.imbalance} mm3"
            f"  {simulated:5.1f} s  {simulated / max(wall, 1e-9):4.1f} x real time"
        )
        if sys.stdout.isatty():
            print("\r" + line.ljust(118), end="", flush=True)
        else:
            print(line, flush=True)

    def _outcome(self, wall: float) -> Outcome:
        columns = self.world.soil.columns
        particles = self.machine.particles
        view = self._operated.view()
        pose = (
            self.machine.machine.description,
            view.base_position,
            view.base_rotation,
            view.joints,
        )
        return Outcome(
            site=self.site,
            grid=self.site.grid,
            after=columns.height.copy(),
            loose_depth=columns.loose_depth,
            cycles=list(self.operator.reports),
            ledger=self.world.ledger,
            worst_imbalance=self._worst,
            moved=sum(cycle.moved for cycle in self.operator.reports),
            simulated=self.world.tick * self._dt,
            wall=wall,
            most_particles=self._most,
            tunnelled=particles.tunnelled_tool + particles.tunnelled_ground,
            given_up=self.operator.given_up,
            state_hash=self.world.state_hash(),
            state_tick=self.world.tick,
            ran_as="one process",
            path=np.array([lip for lip, _, _ in self._path]).reshape(-1, 3),
            path_cycle=np.array([cycle for _, cycle, _ in self._path], dtype=np.int64),
            path_phase=np.array([phase for _, _, phase in self._path], dtype=np.str_),
            machine_faces=machine_faces(*pose, self.machine.machine.tracks.shoe_poses),
            machine_outline=machine_outline(*pose),
            machine_position=(float(view.base_position[0]), float(view.base_position[1])),
        )

"""Milling of a face by the shipped road header: balance of energy, and rate.

    python -m benchmarks.validation.face_milling

The drive of the head delivers W, the feed presses the head into the ground; the head has the
kinetic energy E. Work is taken out of the head
by milling, the specific energy of the ground times its volume, and by cuttings that touch it:

    W + feed = E(end) - E(start) + milling + cuttings

The terms are measured independently: W from torque and speed of the joint, the work of the cuttings
from the wrench of the particles, milling from the firm rock that the terrain has lost. At ticks of
one physics step every step can be observed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dig_operator import FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import load_machine_spec
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import SoilReaction
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.tool_force.specific_energy import rock_specific_energy

__all__ = ["FaceSite", "MillingResult", "mill_face"]

FACE = FaceCuttingParams(width=2.6, height=1.6, rounds=1, timeout=400.0)
"""The face that the operator cuts."""
_GRID = Grid(101, 101, 0.1)
_FACE_X, _FACE_HEIGHT = 2.2, 1.8
_MACHINE_X = -3.15
"""Position of the machine [m]: the head is 0.1 m before the face."""
_HOME = (0.0, 0.2, 0.0)
"""Initial angles of turn, lift and head [rad]: the head is 0.7 m above the floor."""
_NOMINAL_VOLUME = 4_000_000
"""Bank volume of a particle [mm^3]."""
_COMMAND_INTERVAL_TICKS = 4


@dataclass
class MillingResult:
    """What a head has done so far.

    Attributes:
        time: simulated time in which soil was milled [s].
        drive_work: work of the head's drive [J].
        feed_work: work of the feed against the soil in front of the head [J].
        cuttings_work: work of the head against cuttings [J].
        kinetic_energy: increase of the kinetic energy of the head [J].
        milling_work: work that the soil states to have taken [J].
        firm_volume: bank volume of firm ground that the terrain has lost [m^3].
        specific_energy: of that ground [J/m^3]; NaN unless it is rock.
    """

    time: float = 0.0
    drive_work: float = 0.0
    feed_work: float = 0.0
    cuttings_work: float = 0.0
    kinetic_energy: float = 0.0
    milling_work: float = 0.0
    firm_volume: float = 0.0
    specific_energy: float = float("nan")

    @property
    def rate(self) -> float:
        """Volume per time in which soil was milled [m^3/h]."""
        return 3600.0 * self.firm_volume / max(self.time, 1e-9)

    @property
    def imbalance(self) -> float:
        """Work of drive and feed without a counterpart over that of the drive [-]; rock only."""
        spent = self.specific_energy * self.firm_volume + self.cuttings_work + self.kinetic_energy
        return (self.drive_work + self.feed_work - spent) / self.drive_work


class FaceSite:
    """A road header before a face.

    Attributes:
        world: soil and machine.
        sim: the machine.
        result: sums since the start.
    """

    def __init__(self, soil: str) -> None:
        """
        Args:
            soil: kind of soil of floor and face.
        """
        heights = np.zeros(_GRID.shape)
        heights[_GRID.x(np.arange(_GRID.rows)) > _FACE_X] = _FACE_HEIGHT
        self.soil = Soil(_GRID, heights, SoilParams(soil=soil))
        spec = load_machine_spec(find_config("machines/road_header.yaml"))
        spec = replace(spec, home=np.array(_HOME))
        self.sim = MachineSim(
            [Placement(spec, (_MACHINE_X, 0.0))],
            _GRID,
            heights,
            params=MachineSimParams(steps_per_tick=1),
            particle_params=ParticleParams(nominal_volume=_NOMINAL_VOLUME),
            soils=self.soil.loose_soils,
            soil=self.soil.columns.top_soil,
            moisture=self.soil.columns.top_moisture,
        )
        self.world = World(self.soil, {1: self.sim})
        self.result = MillingResult()
        tensile_strength = self.soil.soil_types[0].tensile_strength
        if tensile_strength > 0.0:
            self.result.specific_energy = float(rock_specific_energy(tensile_strength))
        self._firm_mm3 = int(self.soil.columns.firm.sum())
        self._coupling = self.sim.tool_coupling
        self._start_energy = self._energy

    @property
    def head_speed(self) -> float:
        """Angular speed of the head [rad/s]."""
        return self._coupling.tool.drum_speed

    @property
    def head_front(self) -> float:
        """Position x of the foremost pick tips [m]."""
        return float(self._coupling.key_points_at(0)[:, 0].max())

    @property
    def _energy(self) -> float:
        return 0.5 * self._coupling.tool.inertia * self.head_speed**2

    def step(self) -> None:
        """Advance by one tick, and add its work to the result."""
        tool, result, dt = self._coupling.tool, self.result, self.sim.params.tick_period
        speed, axis = tool.drum_speed, tool.pose[0][:, 1]
        force, _ = self._coupling.wrench  # applied in the step that follows
        particle_force, particle_torque = self.sim.particles.tool_wrench(self._coupling.tool_id)
        if self.world.step().imbalance:
            raise AssertionError(f"the volume of tick {self.world.tick} is not balanced")
        mean_speed = 0.5 * (speed + tool.drum_speed)
        result.drive_work += float(self.sim.machine.joint_efforts[2]) * mean_speed * dt
        result.cuttings_work -= float(particle_torque @ axis) * mean_speed * dt
        result.feed_work -= float((force - particle_force) @ tool.velocity[0]) * dt
        result.kinetic_energy = self._energy - self._start_energy
        answer = self.world.answers.get(1)
        if answer is not None:
            milled = answer.forces[answer.forces["reaction"] == SoilReaction.MILL]
            work = float(milled["work"].sum())
            result.milling_work += work
            result.time += dt if work > 0.0 else 0.0
        firm_mm3 = int(self.soil.columns.firm.sum())
        result.firm_volume = (self._firm_mm3 - firm_mm3) * 1e-9

    def drive(self, speed: float, head: float, seconds: float) -> None:
        """Drive with both tracks at a speed [m/s], and the head at an angular speed [rad/s]."""
        for _ in range(round(seconds / self.sim.params.tick_period)):
            self.sim.machine.command({"head": head}, [speed, speed])
            self.step()

    def cut(self, params: FaceCuttingParams, report: Callable[[str], None] = print) -> float:
        """Let the operator cut a face; return the simulated time of the task [s].

        Raises:
            AssertionError: the task was aborted.
        """
        task = FaceCuttingTask(self.sim.machine.spec, params)
        period = self.sim.params.tick_period
        operated = OperatedMachine(self.world, self.sim.simulated_machines[0], task, period)
        start, phase = self.world.tick, task.phase
        while not task.done:
            operated.observe_and_command(_COMMAND_INTERVAL_TICKS * period)
            for _ in range(_COMMAND_INTERVAL_TICKS):
                self.step()
            if task.phase is not phase:
                phase = task.phase
                report(f"{self.world.tick * period:6.1f} s: {phase}")
        if task.abort_reason:
            raise AssertionError(task.abort_reason)
        return (self.world.tick - start) * period


def mill_face(
    soil: str, params: FaceCuttingParams = FACE, report: Callable[[str], None] = lambda line: None
) -> tuple[MillingResult, float]:
    """Let the operator cut a face of a kind of soil.

    Args:
        soil: kind of soil.
        params: the face.
        report: prints the progress.

    Returns:
        (What the head has done, time of the whole task [s]).
    """
    site = FaceSite(soil)
    seconds = site.cut(params, report)
    site.world.close()
    return site.result, seconds


def main() -> None:
    """Cut a face of rock and one of loam, and print the balances."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    for soil in ("rock", "loam"):
        result, seconds = mill_face(soil, report=print)
        print(
            f"{soil}: face in {seconds:.0f} s, milled in {result.time:.0f} s at"
            f" {result.rate:.1f} m3/h, drive {result.drive_work / 1e6:.2f} MJ, milling"
            f" {result.milling_work / 1e6:.2f} MJ, cuttings {result.cuttings_work / 1e6:.3f} MJ,"
            f" feed {result.feed_work / 1e6:.3f} MJ, imbalance {100.0 * result.imbalance:.2f} %"
        )


if __name__ == "__main__":
    main()

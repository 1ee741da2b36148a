"""A tool at work: what it sweeps, what it has cut, what it holds, and what soil does to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import Tool
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.params import MachineSimParams
from machine_sim.particles import Pose, SoilEngine
from machine_sim.work.milling import Milling
from machine_sim.work.payload import Payload, payload_in
from machine_sim.work.release import PendingSoil
from machine_sim.work.resistance import Resistance
from machine_sim.work.sweep import BucketSweep, DrumSweep
from msg_bridge.contract.rows import SWEEP, Rows, empty_rows

__all__ = ["ToolWork"]

_POSES = 4
"""Poses of the tool at the ends of ticks that are remembered."""

_NOTHING = (np.zeros(3), np.zeros(3))
"""No force and no torque."""


class ToolWork:
    """One tool of a machine, in the particle engine and toward the soil.

    Attributes:
        tool: on its machine.
        number: in rows, and its id in the particle engine.
        payload: soil in it at the end of the last tick; None for one that holds none.
        pending: what it has cut and is not yet particles; None for one that does not cut.
        resistance: what resists its cut and bears it; None for one that does not cut.
    """

    def __init__(
        self,
        tool: Tool,
        number: int,
        particles: SoilEngine,
        params: MachineSimParams,
        machine_mass: float,
        rng: np.random.Generator,
    ) -> None:
        """
        Args:
            tool: on its machine.
            number: that no other tool of the node has.
            particles: the soil that it may touch.
            params: how the node steps.
            machine_mass: of the whole machine [kg].
            rng: scatters particles that appear at one place.
        """
        self.tool, self.number = tool, number
        self._params, self._particles = params, particles
        shape = tool.shape
        particles.add_tool(number, shape.plates(), tool.pose, digs=not isinstance(shape, BedShape))
        self.payload: Payload | None = None
        self.pending: PendingSoil | None = None
        self.resistance: Resistance | Milling | None = None
        self._sweep: BucketSweep | DrumSweep | None = None
        if not isinstance(shape, BedShape):
            self.pending = PendingSoil(
                shape,
                rng,
                nominal_mm3=particles.params.nominal_volume,
                per_tick=params.release_per_tick,
            )
        if isinstance(shape, DrumShape):
            self.resistance = Milling(tool.mass, machine_mass, tool.inertia, params.physics_step)
            self._sweep = DrumSweep(shape, number)
        elif not isinstance(shape, BedShape):
            self.resistance = Resistance(tool.mass, machine_mass, params.physics_step)
            self._sweep = BucketSweep(shape, number)
        self._resisted = _NOTHING
        self._start = self._before = tool.pose
        self._frames = deque([tool.frame], maxlen=_POSES)
        self._count()

    @property
    def wrench(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the soil on it and torque about its frame's origin [N m], map axes.

        Its load and what resists its cut, as of the end of the last step.
        """
        force, torque = self._particles.tool_wrench(self.number)
        return force + self._resisted[0], torque + self._resisted[1]

    def frame_at(self, ticks_since: int) -> Pose:
        """Its frame at the end of the tick that many ticks ago."""
        return self._frames[max(-1 - ticks_since, -len(self._frames))]

    def distances(self, places: NDArray[np.float64], ticks_since: int) -> NDArray[np.float64]:
        """From places [m], map frame, shape (n, 3), to its nearest key point then, shape (n,)."""
        shape = self.tool.shape
        if isinstance(shape, BedShape):
            return np.full(len(places), np.inf)
        rotation, origin = self.frame_at(ticks_since)
        points = shape.key_points @ rotation.T + origin
        return np.asarray(
            np.linalg.norm(places[:, None] - points[None], axis=2).min(axis=1), dtype=np.float64
        )

    def hear(self, forces: Rows, ticks_since: int) -> None:
        """Take the soil's FORCE rows of this node's tools, as of that many ticks ago."""
        if self.resistance is None:
            return
        own = forces[forces["tool"] == self.number]
        if own.size:
            self.resistance.hear(own, self.frame_at(ticks_since))

    def begin_tick(self, tick: int) -> None:
        """Begin a tick of some number: what it has cut comes loose."""
        self._start = self.tool.pose
        if self.resistance is not None:
            self.resistance.tick()
        if self.pending is not None:
            velocity = self.tool.velocity if isinstance(self.tool.shape, DrumShape) else None
            self.pending.release(self._particles, self.tool.frame, tick, velocity)

    def before_step(self) -> None:
        """Note where it is before the machine moves."""
        self._before = self.tool.pose

    def after_step(self) -> None:
        """Tell the particles where it went."""
        self._particles.set_tool(self.number, self._before, self.tool.pose)

    def feel(self, dt: float) -> None:
        """Let its load, and the soil that it cuts and stands on, act in the next physics step."""
        if self._params.load_acts:
            self.tool.push(*self._particles.tool_wrench(self.number))
        resistance = self.resistance
        if not self._params.cutting_acts or resistance is None:
            return
        self._resisted = _NOTHING
        if resistance.holds:
            self._resisted = resistance.step(self.tool.frame, self.tool.velocity, dt)
            self.tool.push(*self._resisted)

    def end_tick(self) -> Rows:
        """End a tick; SWEEP rows of what it swept."""
        self._frames.append(self.tool.frame)
        self._count()
        sweep, end = self._sweep, self.tool.pose
        if sweep is None:
            return empty_rows(SWEEP)
        if isinstance(sweep, DrumSweep):
            return sweep.rows(self._start, end, self.tool.spin)
        return sweep.rows(self._start, end)

    @property
    def state(self) -> Iterable[NDArray[np.generic]]:
        """What shows that two runs differ, for a digest."""
        if self.pending is not None:
            yield np.array([self.pending.total_mm3])
        if self.resistance is not None:
            yield self.resistance.state

    def _count(self) -> None:
        shape = self.tool.shape
        if not isinstance(shape, DrumShape):
            self.payload = payload_in(shape, self._particles, self.tool.pose)

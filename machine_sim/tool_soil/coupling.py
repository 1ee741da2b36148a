"""A tool at work: what it sweeps, what it has cut, what it holds, and what soil does to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine import Tool
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.milling_resistance import MillingResistance
from machine_sim.tool_soil.payload import Payload, measure_payload
from machine_sim.tool_soil.pending_soil import PendingSoil
from machine_sim.tool_soil.resistance import SoilResistance
from machine_sim.tool_soil.sweep import BucketSweep, DrumSweep
from msg_bridge.contract.rows import SWEEP, Rows, empty_rows

__all__ = ["ToolSoilCoupling"]

_MAX_FRAMES = 4
"""Poses of the tool at the ends of ticks that are remembered."""

_ZERO_WRENCH = (np.zeros(3), np.zeros(3))
"""No force and no torque."""


class ToolSoilCoupling:
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
        tool_id: int,
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
        self.tool, self.tool_id = tool, tool_id
        self._params, self._particles = params, particles
        shape = tool.shape
        particles.add_tool(
            tool_id, shape.plates(), tool.pose, is_digging=not isinstance(shape, BedShape)
        )
        self.payload: Payload | None = None
        self.pending: PendingSoil | None = None
        self.resistance: SoilResistance | MillingResistance | None = None
        self._sweep: BucketSweep | DrumSweep | None = None
        if not isinstance(shape, BedShape):
            self.pending = PendingSoil(
                shape,
                rng,
                nominal_mm3=particles.params.nominal_volume,
                max_per_tick=params.max_releases_per_tick,
            )
        if isinstance(shape, DrumShape):
            self.resistance = MillingResistance(
                tool.mass, machine_mass, tool.inertia, params.physics_step
            )
            self._sweep = DrumSweep(shape, tool_id)
        elif not isinstance(shape, BedShape):
            self.resistance = SoilResistance(tool.mass, machine_mass, params.physics_step)
            self._sweep = BucketSweep(shape, tool_id)
        self._resistance_wrench = _ZERO_WRENCH
        self._tick_start_pose = self._previous_pose = tool.pose
        self._frame_history = deque([tool.frame], maxlen=_MAX_FRAMES)
        self._update_payload()

    @property
    def wrench(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the soil on it and torque about its frame's origin [N m], map axes.

        Its load and what resists its cut, as of the end of the last step.
        """
        force, torque = self._particles.tool_wrench(self.tool_id)
        return force + self._resistance_wrench[0], torque + self._resistance_wrench[1]

    def frame_at(self, ticks_ago: int) -> Pose:
        """Its frame at the end of the tick that many ticks ago."""
        return self._frame_history[max(-1 - ticks_ago, -len(self._frame_history))]

    def distances_to_key_points(
        self, places: NDArray[np.float64], ticks_ago: int
    ) -> NDArray[np.float64]:
        """From places [m], map frame, shape (n, 3), to its nearest key point then, shape (n,)."""
        shape = self.tool.shape
        if isinstance(shape, BedShape):
            return np.full(len(places), np.inf)
        rotation, origin = self.frame_at(ticks_ago)
        points = shape.key_points @ rotation.T + origin
        return np.asarray(
            np.linalg.norm(places[:, None] - points[None], axis=2).min(axis=1), dtype=np.float64
        )

    def receive(self, forces: Rows, ticks_ago: int) -> None:
        """Take the soil's FORCE rows of this node's tools, as of that many ticks ago."""
        if self.resistance is None:
            return
        own = forces[forces["tool"] == self.tool_id]
        if own.size:
            self.resistance.receive(own, self.frame_at(ticks_ago))

    def begin_tick(self, tick: int) -> None:
        """Begin a tick of some number: what it has cut comes loose."""
        self._tick_start_pose = self.tool.pose
        if self.resistance is not None:
            self.resistance.begin_tick()
        if self.pending is not None:
            velocity = self.tool.velocity if isinstance(self.tool.shape, DrumShape) else None
            self.pending.release(self._particles, self.tool.frame, tick, velocity)

    def before_step(self) -> None:
        """Note where it is before the machine moves."""
        self._previous_pose = self.tool.pose

    def after_step(self) -> None:
        """Tell the particles where it went."""
        self._particles.set_tool_motion(self.tool_id, self._previous_pose, self.tool.pose)

    def apply_soil_forces(self, dt: float) -> None:
        """Let its load, and the soil that it cuts and stands on, act in the next physics step."""
        if self._params.payload_coupling:
            self.tool.push(*self._particles.tool_wrench(self.tool_id))
        resistance = self.resistance
        if not self._params.cutting_forces or resistance is None:
            return
        self._resistance_wrench = _ZERO_WRENCH
        if resistance.is_active:
            self._resistance_wrench = resistance.step(self.tool.frame, self.tool.velocity, dt)
            self.tool.push(*self._resistance_wrench)

    def end_tick(self) -> Rows:
        """End a tick; SWEEP rows of what it swept."""
        self._frame_history.append(self.tool.frame)
        self._update_payload()
        sweep, end = self._sweep, self.tool.pose
        if sweep is None:
            return empty_rows(SWEEP)
        if isinstance(sweep, DrumSweep):
            return sweep.rows(self._tick_start_pose, end, self.tool.drum_speed)
        return sweep.rows(self._tick_start_pose, end)

    @property
    def state(self) -> Iterable[NDArray[np.generic]]:
        """What shows that two runs differ, for a digest."""
        if self.pending is not None:
            yield np.array([self.pending.total_mm3])
        if self.resistance is not None:
            yield self.resistance.state

    def _update_payload(self) -> None:
        shape = self.tool.shape
        if not isinstance(shape, DrumShape):
            self.payload = measure_payload(shape, self._particles, self.tool.pose)

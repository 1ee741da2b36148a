"""Coupling of one tool with the soil: its sweep, its pending soil, its payload, and soil forces."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine import MachineError, Tool
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.payload import Payload
from machine_sim.tool_soil.pending_soil import PendingSoil
from machine_sim.tool_soil.room import ReportedRoom
from machine_sim.tool_soil.tools import ToolMotion, make_interaction
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.rows import FORCE, MAX_MILLING_WORK, Rows
from msg_bridge.kernels import kernel

__all__ = ["ToolSoilCoupling"]

_NUM_FRAMES = 4
"""Number of past tool frames that are kept, one per tick: answers lag by at most three ticks."""

_ZERO_WRENCH = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""No force and no torque."""


class ToolSoilCoupling:
    """One tool of a machine, its particles, and its exchange of rows with the soil.

    What depends on the kind of tool is in its `ToolInteraction`.

    Attributes:
        tool: the tool on its machine.
        tool_id: id of the tool in rows and in the particle engine.
        is_digging: whether the tool excavates.
        payload: soil in the tool at the end of the last tick; empty for a tool that carries none.
        pending: excavated soil that is not yet particles.
        resistance: forces of the ground on the tool.
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
            tool: the tool on its machine.
            tool_id: id that no other tool of the node has.
            particles: engine of the particles that the tool may touch.
            params: stepping of the node.
            machine_mass: mass of the whole machine [kg].
            rng: generator that scatters particles released at one point.
        """
        self.tool, self.tool_id = tool, tool_id
        self._params, self._particles = params, particles
        self._interaction = interaction = make_interaction(tool.shape, tool_id)
        self.is_digging = interaction.is_digging
        particles.add_tool(
            tool_id,
            tool.shape.plates(),
            tool.pose,
            is_digging=self.is_digging,
            is_milling=interaction.is_milling,
        )
        self.pending = interaction.make_pending(
            rng,
            nominal_mm3=particles.params.nominal_volume,
            max_per_tick=params.max_releases_per_tick,
        )
        self.resistance = interaction.make_resistance(tool, machine_mass, params)
        self._resistance_wrench = _ZERO_WRENCH
        self._last_pose = tool.pose
        self._frame_history = deque([tool.frame], maxlen=_NUM_FRAMES)
        self._reported_room = ReportedRoom(_NUM_FRAMES)
        self.payload: Payload = interaction.measure(particles, tool.pose)[0]

    def continue_from(self, other: ToolSoilCoupling) -> None:
        """Take soil, recent poses and reported room from the coupling of a tool in the same pose.

        The ground exerts no force until the next answer of the soil.

        Raises:
            MachineError: one of the tools digs and the other does not.
        """
        if isinstance(self.pending, PendingSoil) and isinstance(other.pending, PendingSoil):
            self.pending.continue_from(other.pending)
        elif type(self.pending) is not type(other.pending):
            raise MachineError(
                "a tool that digs cannot take the place of one that does not, nor the reverse; give"
                " a tool of the same kind"
            )
        self._last_pose = self.tool.pose
        self._frame_history = deque(other._frame_history, maxlen=_NUM_FRAMES)
        self._reported_room.continue_from(other._reported_room)
        self._particles.set_tool_motion(self.tool_id, self.tool.pose, self.tool.pose)

    @property
    def wrench(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the soil on the tool and torque about its frame's origin [N m], map axes.

        The sum of its load and its resistance at the end of the last step.
        """
        force, torque = self._particles.tool_wrench(self.tool_id)
        return force + self._resistance_wrench[0], torque + self._resistance_wrench[1]

    def frame_at(self, ticks_ago: int) -> Pose:
        """Return the tool's non-spinning frame at the end of the tick `ticks_ago` ticks ago."""
        return self._frame_history[max(-1 - ticks_ago, -len(self._frame_history))]

    @property
    def key_points(self) -> NDArray[np.float64]:
        """Key points of the cutting contour [m], tool frame, shape (n, 3)."""
        return self._interaction.key_points

    def key_points_at(self, ticks_ago: int) -> NDArray[np.float64]:
        """Return the key points [m], map frame, shape (n, 3), at the end of an earlier tick.

        Args:
            ticks_ago: number of ticks since then.
        """
        rotation, origin = self.frame_at(ticks_ago)
        return self.key_points @ rotation.T + origin

    def distances_to_key_points(
        self, points: NDArray[np.float64], ticks_ago: int
    ) -> NDArray[np.float64]:
        """Return the distance from points to the nearest key point of a digging tool.

        Args:
            points: [m], map frame, shape (n, 3).
            ticks_ago: number of ticks since the tool's pose that counts.

        Returns:
            Distances [m], shape (n,).
        """
        distances: NDArray[np.float64] = _nearest_distances(points, self.key_points_at(ticks_ago))
        return distances

    def receive(self, forces: Rows, ticks_ago: int) -> None:
        """Take FORCE rows of this node's tools that answer the tick `ticks_ago` ticks ago."""
        self._reported_room.receive_answer(ticks_ago)
        if forces.size == 0:
            return
        own = np.empty(forces.size, FORCE)
        count = _copy_rows_of_tool(forces, self.tool_id, own)
        if count:
            self.resistance.receive(own[:count], self.frame_at(ticks_ago))

    def begin_tick(self, tick: int) -> None:
        """Begin the tick of a number: release pending soil as particles."""
        self.resistance.begin_tick()
        self.pending.release(
            self._particles, self.tool.frame, tick, self._interaction.release_twist(self.tool)
        )

    def after_step(self) -> None:
        """Pass the tool's motion in the physics step to the particle engine."""
        start, self._last_pose = self._last_pose, self.tool.pose
        self._particles.set_tool_motion(self.tool_id, start, self._last_pose)

    def apply_soil_forces(self, dt: float) -> None:
        """Apply load and resistance to the machine in the next physics step of `dt` [s]."""
        push = (0.0, 0.0, 0.0)
        if self._params.payload_coupling:
            load = self._particles.tool_load(self.tool_id)
            if any(load):
                self.tool.add_wrench(load)
                push = (load[0], load[1], load[2] + GRAVITY * self.payload.mass_kg)
        if not self._params.cutting_forces:
            return
        self._resistance_wrench = _ZERO_WRENCH
        if self.resistance.is_active:
            self._resistance_wrench = self.resistance.step(
                self.tool.frame, self.tool.velocity, dt, push
            )
            force, torque = self._resistance_wrench
            self.tool.add_wrench([*force, *torque])

    def end_tick(self) -> Rows:
        """End a tick and return its SWEEP rows."""
        start, end = self.frame_at(0), self.tool.frame
        self._frame_history.append(end)
        self.payload, free_mm3 = self._interaction.measure(self._particles, self.tool.pose)
        room = 0
        if self.is_digging:
            if free_mm3 != math.inf:
                free_mm3 = max(free_mm3 - self.pending.total_mm3, 0.0)
                free_mm3 *= self.resistance.inflow_fraction
            room = self._reported_room.report(free_mm3)
        work = self.resistance.deliverable_work
        if work > 0.0 and not self._params.cutting_forces:
            work = MAX_MILLING_WORK  # nothing brakes the drum
        return self._interaction.sweep(ToolMotion(start, end, room, self.tool.is_driven, work))

    def reset(self) -> None:
        """Remove the soil forces and the room reported, which belong to earlier ticks of a run."""
        self.resistance.reset()
        self._reported_room.reset()

    @property
    def state(self) -> Iterable[NDArray[np.generic]]:
        """Arrays for the state hash."""
        yield self.pending.state
        yield self._reported_room.state
        yield self.resistance.state


@kernel
def _nearest_distances(points, key_points):  # type: ignore[no-untyped-def]
    """Return the distance of each point from the nearest of some key points [m], shape (n,)."""
    distances = np.empty(len(points))
    for i in range(len(points)):
        nearest = math.inf
        for k in range(len(key_points)):
            square = 0.0
            for j in range(3):
                square += (points[i, j] - key_points[k, j]) ** 2
            nearest = min(nearest, square)
        distances[i] = math.sqrt(nearest)
    return distances


@kernel
def _copy_rows_of_tool(forces, tool_id, own):  # type: ignore[no-untyped-def]
    """Copy the FORCE rows of a tool to the front of `own`, and return their number.

    The soil sends the forces of all tools that cut before those of all that it bears. NumPy takes
    ten times as long to select rows.
    """
    count = 0
    for n in range(forces.size):
        if forces[n].tool == tool_id:
            own[count] = forces[n]
            count += 1
    return count

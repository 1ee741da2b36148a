"""A machine at work: on the ground, in the physics engine, its tools in the soil."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineSpec, TrackedMachine
from machine_sim.machine.tracks.track_model import sole_heights
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.coupling import ToolSoilCoupling
from machine_sim.tool_soil.payload import Payload
from machine_sim.tool_soil.sweep import TrackSweep
from msg_bridge.contract.rows import SWEEP, Rows, join_rows

__all__ = ["Placement", "SimulatedMachine"]

_NUM_TRACKS = 2


@dataclass(frozen=True, eq=False)
class Placement:
    """A machine, and where it starts.

    Attributes:
        description: dimensions, masses and limits.
        position: where it is set down on the ground (x, y) [m], map frame.
        yaw: where it faces [rad], from +x counter-clockwise.
    """

    spec: MachineSpec
    position: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0


class SimulatedMachine:
    """One machine of a node, with all that soil and it do to each other.

    Attributes:
        machine: in the physics engine.
        tools: at work, by name.
        numbers: how many numbers of tools it takes, its tracks' included.
    """

    def __init__(
        self,
        placement: Placement,
        client: int,
        ground: Ground,
        particles: SoilEngine,
        params: MachineSimParams,
        *,
        first_tool_id: int,
        seed: int,
    ) -> None:
        """
        Args:
            placement: the machine and where it starts.
            client: number of the physics client.
            ground: what it stands on.
            particles: soil that it may touch.
            params: how the node steps.
            first_number: of its first tool in rows; the others and the tracks follow.
            seed: of the scatter of released particles.

        Raises:
            MachineError: a place off the map, or tracks that the machine cannot have.
        """
        spec = placement.spec
        self.machine = TrackedMachine(
            spec, client, ground, placement.position, placement.yaw, params.track_model
        )
        self.tools = {
            name: ToolSoilCoupling(
                tool,
                first_tool_id + k,
                particles,
                params,
                spec.mass,
                np.random.default_rng((seed, first_tool_id + k)),
            )
            for k, (name, tool) in enumerate(self.machine.tools.items())
        }
        self.num_tool_ids = len(self.tools) + _NUM_TRACKS
        self._track_sweep = TrackSweep(self.machine.spec.tracks, first_tool_id + len(self.tools))
        self._last_base_frame = self.machine.base_frame

    @property
    def payload(self) -> Payload:
        """Soil in all its tools at the end of the last tick; the fill is that of the fullest."""
        held = [work.payload for work in self.tools.values()]
        return Payload(
            sum(each.bank for each in held),
            sum(each.loose for each in held),
            sum(each.mass for each in held),
            max((each.fill for each in held), default=0.0),
        )

    def begin_tick(self, tick: int) -> None:
        """Begin a tick of some number."""
        for work in self.tools.values():
            work.begin_tick(tick)

    def before_step(self, dt: float) -> None:
        """Give the physics engine what acts on it in its next step of `dt` [s]."""
        for work in self.tools.values():
            work.before_step()
        self.machine.before_step(dt)

    def after_step(self) -> None:
        """Take over where the physics engine has moved it to."""
        self.machine.after_step()
        for work in self.tools.values():
            work.after_step()

    def apply_soil_forces(self, dt: float) -> None:
        """Let soil act on its tools in the next physics step of `dt` [s]."""
        for work in self.tools.values():
            work.apply_soil_forces(dt)

    def end_tick(self) -> Rows:
        """End a tick; SWEEP rows of its tools and its tracks."""
        swept = [work.end_tick() for work in self.tools.values()]
        stood, self._last_base_frame = self._last_base_frame, self.machine.base_frame
        ruts = self._track_sweep.rows(
            stood, self._last_base_frame, sole_heights(self.machine.tracks)
        )
        return join_rows([*swept, ruts], SWEEP)

    @property
    def state(self) -> Iterable[NDArray[np.generic]]:
        """What shows that two runs differ, for a digest."""
        machine = self.machine
        yield machine.joint_positions
        yield machine.joint_velocities
        yield from machine.base_pose
        yield from machine.base_velocity
        for work in self.tools.values():
            yield from work.state

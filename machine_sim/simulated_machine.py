"""Simulated machine: its physics, its tracks on the ground, and its tools in the soil."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineError, MachineSpec, TrackedMachine
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.coupling import ToolSoilCoupling
from machine_sim.tool_soil.payload import Payload
from machine_sim.tool_soil.sweep import TrackSweep
from msg_bridge.contract.cylinder_state import CylinderState
from msg_bridge.contract.rows import Rows

__all__ = ["Placement", "SimulatedMachine"]

_NUM_TRACKS = 2


@dataclass(frozen=True, eq=False)
class Placement:
    """A machine and its initial pose.

    Attributes:
        spec: dimensions, masses and limits.
        position: initial position on the ground (x, y) [m], map frame.
        yaw: initial heading [rad], from +x counter-clockwise.
    """

    spec: MachineSpec
    position: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0


class SimulatedMachine:
    """One machine of a node and its interaction with soil.

    Attributes:
        machine: the machine in the physics engine.
        couplings: coupling of each tool with the soil, by the name of the tool.
        num_tool_ids: number of tool ids that its tools and tracks take.
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
            placement: the machine and its initial pose.
            client: id of the physics client.
            ground: ground that it stands on.
            particles: engine of the particles that it may touch.
            params: stepping of the node.
            first_tool_id: id of its first tool in rows; its other tools and its tracks follow.
            seed: seed of the scatter of released particles.

        Raises:
            MachineError: a position off the map, or a track model that does not fit the machine.
        """
        spec = placement.spec
        self.machine = TrackedMachine(
            spec, client, ground, placement.position, placement.yaw, params.track_model
        )
        self.couplings = {
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
        self.num_tool_ids = len(self.couplings) + _NUM_TRACKS
        self._track_sweep = TrackSweep(self.machine.tracks, first_tool_id + len(self.couplings))
        self._last_base_frame = self.machine.base_frame
        self._grid = ground.grid
        self._efforts: list[list[float]] = []  # `drive_efforts` of each physics step of a tick

    def continue_from(self, other: SimulatedMachine) -> None:
        """Take pose, motion and pending soil of a machine that may have another specification.

        Raises:
            MachineError: other tools; or as `TrackedMachine.continue_from`.
        """
        tools, before = list(self.couplings), list(other.couplings)
        if tools != before:
            raise MachineError(
                f"the machine has the tools {', '.join(before)}, and {', '.join(tools)} are given;"
                " give a machine with these tools"
            )
        self.machine.continue_from(other.machine)
        for name, coupling in self.couplings.items():
            coupling.continue_from(other.couplings[name])
        self._last_base_frame = self.machine.base_frame

    @property
    def payload(self) -> Payload:
        """Soil in all tools at the end of the last tick; the fill is the maximum over the tools."""
        bank_m3 = loose_m3 = mass_kg = fill = 0.0
        for coupling in self.couplings.values():
            payload = coupling.payload
            bank_m3 += payload.bank_m3
            loose_m3 += payload.loose_m3
            mass_kg += payload.mass_kg
            fill = max(fill, payload.fill)
        return Payload(bank_m3, loose_m3, mass_kg, fill)

    @property
    def parts_beyond_map(self) -> list[str]:
        """Which parts are beyond the edge of the map: "base", and names of tools that dig.

        The base is beyond it with the origin of its frame, a tool with any of its key points.
        """
        points = {"base": self.machine.base_pose[0][np.newaxis]}
        for name, coupling in self.couplings.items():
            rotation, origin = coupling.tool.frame
            points[name] = coupling.key_points @ rotation.T + origin
        return [
            name
            for name, each in points.items()
            if not self._grid.contains(each[:, 0], each[:, 1]).all()
        ]

    @property
    def joint_efforts(self) -> NDArray[np.float64]:
        """Drive torques [N m], mean over the physics steps of the last tick, shape (joints,)."""
        return self._mean_efforts[:-_NUM_TRACKS]

    @property
    def drive_forces(self) -> NDArray[np.float64]:
        """Forces of the drives on their belts [N], mean over the physics steps of the last tick,
        positive forward, shape (2,).
        """
        return self._mean_efforts[-_NUM_TRACKS:]

    @property
    def cylinders(self) -> dict[str, CylinderState]:
        """State of the cylinders, by the joint that they drive, with forces from `joint_efforts`
        and pressures from these forces.
        """
        machine = self.machine
        return machine.hydraulics.states(
            machine.joint_positions.tolist(),
            machine.joint_velocities.tolist(),
            self.joint_efforts.tolist(),
        )

    @property
    def _mean_efforts(self) -> NDArray[np.float64]:
        # The torque of a drum in soil can alternate between the steps of a tick: the power from
        # the last steps alone would be wrong by 10 %.
        efforts = np.array(self._efforts or [self.machine.drive_efforts])
        mean: NDArray[np.float64] = efforts.mean(axis=0)
        return mean

    def begin_tick(self, tick: int) -> None:
        """Begin the tick of a number."""
        self._efforts = []
        for coupling in self.couplings.values():
            coupling.begin_tick(tick)

    def before_step(self, dt: float) -> None:
        """Apply drives and loads for the next physics step of `dt` [s]."""
        self.machine.before_step(dt)

    def after_step(self) -> None:
        """Read poses and motions after a physics step."""
        self.machine.after_step()
        self._efforts.append(self.machine.drive_efforts)
        for coupling in self.couplings.values():
            coupling.after_step()

    def apply_soil_forces(self, dt: float) -> None:
        """Apply the forces of soil on the tools in the next physics step of `dt` [s]."""
        for coupling in self.couplings.values():
            coupling.apply_soil_forces(dt)

    def end_tick(self) -> list[Rows]:
        """End a tick, and return the SWEEP rows of each tool and of the tracks."""
        tool_sweeps = [coupling.end_tick() for coupling in self.couplings.values()]
        previous_frame, self._last_base_frame = self._last_base_frame, self.machine.base_frame
        track_sweeps = self._track_sweep.rows(previous_frame, self._last_base_frame)
        return [*tool_sweeps, track_sweeps]

    @property
    def state(self) -> Iterable[NDArray[np.generic]]:
        """Arrays for the state hash."""
        machine = self.machine
        yield machine.joint_positions
        yield machine.joint_velocities
        yield from machine.base_pose
        yield from machine.base_velocity
        for coupling in self.couplings.values():
            yield from coupling.state

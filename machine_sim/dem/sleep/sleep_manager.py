"""Sleep management of an engine: which particles wake before a step and fall asleep after it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts.step_contacts import StepContactTables
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.sleep.apparent_gravity import ApparentGravity
from machine_sim.dem.sleep.fall_asleep import update_sleep
from machine_sim.dem.sleep.locked_load import move_locked_loads
from machine_sim.dem.sleep.sleep_state import (
    AWAKE,
    MovingRows,
    SleepParams,
    locked_tool,
)
from machine_sim.dem.sleep.wake_conditions import WAKE_SPHERE_SIZE
from machine_sim.dem.sleep.wake_disturbed import wake_disturbed
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["SleepManager"]

_NO_SPHERES = np.zeros((0, WAKE_SPHERE_SIZE))
_NO_CHANGED_COLUMNS = np.zeros((0, 0), np.bool_)


class SleepManager:
    """Wakes particles whose support may be gone, and puts particles at rest to sleep."""

    def __init__(self, params: ParticleParams) -> None:
        self._wake_spheres: list[NDArray[np.float64]] = []
        self._gravity = ApparentGravity(params.gravity)
        self._params: BoxedTable = box_table(
            SleepParams(
                gravity=params.gravity,
                wake_gravity_change=params.wake_gravity_change * params.gravity,
                wake_speed=params.wake_speed,
                sleep_speed=params.sleep_speed,
                sleep_time=params.sleep_time,
                allow_sleeping=params.allow_sleeping,
                allow_load_locking=params.allow_load_locking,
            )
        )

    def add_tool(self, tool: RigidTool) -> None:
        """Append a tool that has been at rest at its pose so far."""
        self._gravity.add_tool(tool)

    def remove_tool(self, index: int) -> None:
        """Remove a tool; later indices decrease by one. The caller wakes all locked particles."""
        self._gravity.remove_tool(index)

    def request_wake(self, spheres: NDArray[np.float64]) -> None:
        """Wake the particles that reach into spheres before the next step.

        Args:
            spheres: centre and radius [m], map frame, shape (n, WAKE_SPHERE_SIZE).
        """
        if len(spheres):
            self._wake_spheres.append(np.asarray(spheres, dtype=np.float64))

    @staticmethod
    def wake_rows(state: ParticleState, rows: NDArray[np.integer]) -> None:
        """Wake particles; they keep the velocity of their carrier."""
        state.sleep_state[rows] = AWAKE
        state.sleep_timer[rows] = 0.0
        state.wake_reference[rows] = state.position[rows]

    # Before a step.

    def wake_disturbed(
        self, state: ParticleState, tools: ToolSet, ground: Ground, dt: float
    ) -> tuple[int, MovingRows]:
        """Wake the particles that are disturbed in the step to come, which `tools` have begun.

        Returns:
            (number of particles that woke; the rows that move in the step).
        """
        spheres = np.concatenate(self._wake_spheres) if self._wake_spheres else _NO_SPHERES
        self._wake_spheres.clear()
        changed = ground.pop_changed_cells()
        rows, tool_of_locked = np.empty(state.count, np.int64), np.empty(state.count, np.int64)
        num_woken, num_free, num_locked = wake_disturbed(
            dt, self._params, state.boxed, tools.boxed_motion, self._gravity.boxed,
            spheres, _NO_CHANGED_COLUMNS if changed is None else changed, ground.frame,
            rows, tool_of_locked,
        )  # fmt: skip
        moving = MovingRows(rows[: num_free + num_locked], num_free, tool_of_locked[:num_locked])
        return num_woken, moving

    # After a step.

    def move_locked_loads(self, state: ParticleState, tools: ToolSet, moving: MovingRows) -> None:
        """Move locked particles to the end poses; add their weight and inertia to the wrenches.

        Args:
            state: the particles.
            tools: before `ToolSet.end_step`.
            moving: rows of the step, of which one is locked at least.
        """
        move_locked_loads(
            self._gravity.standard, moving.locked, moving.locked_tool, state.boxed,
            tools.boxed_motion, self._gravity.boxed,
        )  # fmt: skip

    def update(
        self,
        state: ParticleState,
        tools: ToolSet,
        rows: NDArray[np.int64],
        contacts: StepContactTables,
        dt: float,
    ) -> tuple[int, int]:
        """Wake particles that moving ones touch, and put those to sleep that have rested enough.

        Args:
            state: the particles.
            tools: before `ToolSet.end_step`.
            rows: rows that moved by forces.
            contacts: contacts of the step.
            dt: [s].

        Returns:
            (number of particles that woke, number that fell asleep).
        """
        num_woken, num_asleep, num_locked = update_sleep(
            dt, self._params, rows, state.boxed, tools.boxed_motion, self._gravity.boxed, *contacts
        )
        if num_locked:
            self._set_locked_positions(state, tools, rows)
        return num_woken, num_asleep

    @staticmethod
    def _set_locked_positions(
        state: ParticleState, tools: ToolSet, rows: NDArray[np.int64]
    ) -> None:
        """Set the wake references of `rows` that are locked to a tool: positions in its frame."""
        tool_of_row = locked_tool(state.sleep_state[rows])
        for t in np.unique(tool_of_row[tool_of_row >= 0]):
            locked_rows = rows[tool_of_row == t]
            rotation, origin = tools.tools[t].end
            state.wake_reference[locked_rows] = (state.position[locked_rows] - origin) @ rotation

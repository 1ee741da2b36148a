"""Sleep management of an engine: which particles wake before a step and fall asleep after it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts.ground_contacts import GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.sleep.apparent_gravity import ApparentGravity
from machine_sim.dem.sleep.locked_load import move_locked_load
from machine_sim.dem.sleep.sleep_state import (
    ASLEEP_ON_MAP,
    AWAKE,
    SleepView,
    locked_state,
    locked_tool,
    mark_loaded_tools,
)
from machine_sim.dem.sleep.sleep_timers import update_sleep_timers
from machine_sim.dem.sleep.support import trace_support
from machine_sim.dem.sleep.wake_conditions import (
    load_approaches_soil,
    wake_in_spheres,
    wake_near_moving_tools,
    wake_on_changed_ground,
    wake_touching,
)
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.pose import ANGULAR
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground

__all__ = ["SleepManager", "StepContacts"]

_MIN_LOCKED_FRACTION = 0.95
"""Minimum fraction of the particles in a tool that can be locked, else none is locked."""
_MAX_REST_TWIST = 1e-6
"""Maximum component of the twist of a tool at rest [m/s, rad/s]."""


class StepContacts(NamedTuple):
    """Contacts of a step, for kernels.

    Attributes:
        pair_contacts: contacts of two particles.
        plate_contacts: particles near plates.
        ground_contacts: particles near the ground.
    """

    pair_contacts: PairContactBlocks
    plate_contacts: PlateCandidates
    ground_contacts: GroundContacts


class SleepManager:
    """Wakes particles whose support may be gone, and puts particles at rest to sleep."""

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self._wake_spheres: list[NDArray[np.float64]] = []
        self._gravity = ApparentGravity(params.gravity)

    @property
    def apparent_gravity(self) -> NDArray[np.float64]:
        """Filtered apparent gravity in each tool [m/s^2], tool axes, shape (tools, 3)."""
        return self._gravity.current

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
    ) -> NDArray[np.int64]:
        """Wake the particles that are disturbed in the step to come, which `tools` have begun.

        Returns:
            Rows that woke.
        """
        self._gravity.update(tools, dt)
        changed = ground.pop_changed_cells()
        rows = np.flatnonzero(state.sleep_state != AWAKE)
        if rows.size == 0:
            self._wake_spheres.clear()
            return rows
        params, view = self._params, state.view(SleepView)
        woken = np.zeros(rows.size, np.bool_)
        wake_load = self._gravity.changed_by(params.wake_gravity_change * params.gravity)
        if self._wake_spheres:
            wake_in_spheres(rows, view, np.concatenate(self._wake_spheres), woken)
            self._wake_spheres.clear()
        if changed is not None:
            wake_on_changed_ground(rows, view, changed, ground.frame, woken)
        is_moving = np.abs(tools.twist).max(axis=1, initial=0.0) > _MAX_REST_TWIST
        if is_moving.any():
            wake_near_moving_tools(dt, rows, view, is_moving, tools.motion, woken, wake_load)
            for t in self._locked_tools(state, rows, len(tools.tools)):
                if is_moving[t] and not wake_load[t]:
                    wake_load[t] = load_approaches_soil(dt, t, tools.motion, rows, view, woken)
        if wake_load.any():
            tool_of_row = locked_tool(state.sleep_state[rows].astype(np.int64))
            woken |= (tool_of_row >= 0) & wake_load[tool_of_row]
        rows = rows[woken]
        self.wake_rows(state, rows)
        return rows

    @staticmethod
    def _locked_tools(state: ParticleState, rows: NDArray[np.integer], num_tools: int) -> list[int]:
        """Return the indices of the tools that some of `rows` are locked to, ascending."""
        has_load = np.zeros(num_tools, np.bool_)
        mark_loaded_tools(rows, state.sleep_state, has_load)
        return [int(tool) for tool in np.flatnonzero(has_load)]

    # After a step.

    def move_locked_loads(
        self,
        state: ParticleState,
        tools: ToolSet,
        locked_rows: NDArray[np.int64],
        tool_of_row: NDArray[np.int64],
    ) -> None:
        """Move locked particles to the end poses; add their weight and inertia to the wrenches.

        Args:
            state: the particles.
            tools: before `ToolSet.end_step`.
            locked_rows, tool_of_row: locked rows, one at least, and the tool index of each.
        """
        view = state.view(SleepView)
        for t in np.unique(tool_of_row):
            load, centre = move_locked_load(
                t, locked_rows, tool_of_row, tools.path[-1, t], tools.twist[t], state.mass, view
            )
            force = load * (self._gravity.gravity_vector - self._gravity.acceleration[t])
            # The wrench is a sum over the substeps until `end_step` divides it.
            tools.wrench[t, :ANGULAR] += force * tools.substeps
            tools.wrench[t, ANGULAR:] += np.cross(centre, force) * tools.substeps

    def wake_touching(
        self, state: ParticleState, rows: NDArray[np.int64], pair_contacts: PairContactBlocks
    ) -> int:
        """Wake the particles that are touched by one that has moved on.

        Args:
            state: the particles.
            rows: rows that moved in the step that ends.
            pair_contacts: contacts of the step.

        Returns:
            Number of particles that woke.
        """
        if rows.size == state.count:
            return 0
        return int(
            wake_touching(rows, pair_contacts, state.view(SleepView), self._params.wake_speed)
        )

    def put_to_sleep(
        self,
        state: ParticleState,
        tools: ToolSet,
        rows: NDArray[np.int64],
        inside: NDArray[np.int64],
        contacts: StepContacts,
        dt: float,
    ) -> NDArray[np.int64]:
        """Put the particles to sleep that have hardly moved for long enough.

        Args:
            state: the particles.
            tools: before `ToolSet.end_step`.
            rows: awake rows.
            inside: index of the tool in whose hull each of these is, `NO_TOOL` for none.
            contacts: contacts of the step.
            dt: [s].

        Returns:
            Rows that fell asleep.
        """
        params = self._params
        if not params.allow_sleeping:
            return rows[:0]
        falls_asleep = np.zeros(rows.size, np.bool_)
        num_ready = update_sleep_timers(
            rows, inside, state.view(SleepView), tools.path[-1], tools.twist, params.sleep_speed,
            params.sleep_time, dt, falls_asleep,
        )  # fmt: skip
        if num_ready == 0:
            return rows[:0]
        sleep_state = np.full(rows.size, ASLEEP_ON_MAP)
        for t in range(len(tools.tools)):
            locks, stays_awake = self._classify_load(
                state, tools, rows, falls_asleep, inside == t, contacts, t
            )
            sleep_state[locks] = locked_state(t)
            falls_asleep &= ~stays_awake
        self._set_asleep(state, tools, rows[falls_asleep], sleep_state[falls_asleep])
        return rows[falls_asleep]

    def _classify_load(
        self,
        state: ParticleState,
        tools: ToolSet,
        rows: NDArray[np.int64],
        sleep_ready: NDArray[np.bool_],
        inside: NDArray[np.bool_],
        contacts: StepContacts,
        t: int,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which of `rows` are locked to tool `t`, and which must stay awake.

        Soil in a tool must weigh on the tool. So it is locked or stays awake, but does not sleep
        on the map. Soil that leans on something else too may sleep on the map, outside the tool or
        in a tool at rest.
        """
        on_tool, on_other = np.zeros(rows.size, np.bool_), np.zeros(rows.size, np.bool_)
        has_load = bool((state.sleep_state == locked_state(t)).any())
        tool_of_contact = tools.tool_of_plate[contacts.plate_contacts.plate]
        if not has_load and not (sleep_ready & inside).any() and not (tool_of_contact == t).any():
            return on_tool, on_other
        trace_support(
            t, rows, sleep_ready, state.view(SleepView), contacts, tools.motion, on_tool, on_other
        )
        is_moving = np.abs(tools.twist[t]).max() > _MAX_REST_TWIST
        stays_awake = inside & sleep_ready & (~on_other if not is_moving else True)
        if tools.is_digging[t] or is_moving:
            stays_awake |= on_tool & (inside | ~on_other)
        locks = on_tool & ~on_other
        min_locked = _MIN_LOCKED_FRACTION * np.count_nonzero(inside)
        if not self._params.allow_load_locking or (
            not has_load and (not locks.any() or np.count_nonzero(locks & inside) < min_locked)
        ):
            return np.zeros_like(locks), stays_awake | locks
        if not has_load:
            # The first soil of a load defines the gravity under which the load is at rest.
            self._gravity.set_lock(t)
        return locks, stays_awake & ~locks

    @classmethod
    def _set_asleep(
        cls,
        state: ParticleState,
        tools: ToolSet,
        rows: NDArray[np.int64],
        sleep_state: NDArray[np.integer],
    ) -> None:
        """Put `rows` into their sleep states, at rest relative to their carriers."""
        state.sleep_state[rows] = sleep_state
        state.velocity[rows[sleep_state == ASLEEP_ON_MAP]] = 0.0
        state.angular_velocity[rows] = 0.0
        for t in cls._locked_tools(state, rows, len(tools.tools)):
            locked_rows = rows[sleep_state == locked_state(t)]
            rotation, origin = tools.tools[t].end
            state.wake_reference[locked_rows] = (state.position[locked_rows] - origin) @ rotation

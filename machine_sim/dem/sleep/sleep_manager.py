"""Rest: particles at rest are left alone, and soil at rest in a tool rides along as one body.

A particle *rests* when it has hardly moved for a while, seen from what it lies in: the map, or a
tool that holds it. It then moves only with that, costs next to nothing, and is a fixed obstacle to
those awake. It wakes when something changes for it (`waking`):

- what touches it has gone on, however slowly, or was taken away
- the ground under it changes, or a tool comes by
- it rides in a tool (`riding`) that is tilted or shaken: the gravity felt in the tool has left that
  under which the soil came to rest by more than a set part. Until then the soil is carried as one
  body, and its weight and inertia act on the tool. It wakes as one, too, where it comes by other
  soil, the ground's or another tool's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts.ground_contacts import GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.sleep.locked_load import move_locked_loads, trace_support
from machine_sim.dem.sleep.wake_conditions import (
    load_approaches_soil,
    wake_in_spheres,
    wake_near_moving_tools,
    wake_on_changed_ground,
)
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.rigid_tool import RigidTool, ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import kernel

__all__ = ["ASLEEP_ON_MAP", "AWAKE", "SleepManager", "StepContacts", "select_moving_rows"]

AWAKE = 0
"""Values of the store's `resting`: awake, at rest on the map, or 2 + the number of the tool."""
ASLEEP_ON_MAP = 1

_ACCELERATION_FILTER_TIME = 0.06
"""Time over which the gravity felt in a tool is smoothed [s]: a drive's jerks are not shaking."""
_MIN_LOCKED_FRACTION = 0.95
"""Part of the soil in a tool that must be calm before it rides as one body."""
_MAX_REST_TWIST = 1e-6
"""Motion of a tool that is none [m/s, rad/s]."""


class StepContacts(NamedTuple):
    """What touched what in a step.

    Attributes:
        contacts: between particles.
        walls: at plates.
        grounds: on the ground.
    """

    contacts: PairContactBlocks
    plate_contacts: PlateCandidates
    ground_contacts: GroundContacts


class SleepManager:
    """Who rests, and what wakes them.

    Attributes:
        felt: gravity felt in each tool [m/s^2], tool frame, smoothed, shape (tools, 3).
    """

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self._wake_spheres: list[NDArray[np.float64]] = []
        self._gravity_vector = np.array([0.0, 0.0, -params.gravity])
        self.apparent_gravity = np.zeros((0, 3))
        self._gravity_at_lock = np.zeros((0, 3))
        self._tool_acceleration = np.zeros((0, 3))
        self._tool_velocity = np.zeros((0, 3))

    def add_tool(self, tool: RigidTool) -> None:
        """Take a tool in, behind the others, as if it had always been where it is."""
        apparent_gravity = tool.start[0].T @ self._gravity_vector
        self.apparent_gravity = np.vstack([self.apparent_gravity, apparent_gravity])
        self._gravity_at_lock = np.vstack([self._gravity_at_lock, apparent_gravity])
        self._tool_acceleration = np.vstack([self._tool_acceleration, np.zeros(3)])
        self._tool_velocity = np.vstack([self._tool_velocity, np.zeros(3)])

    def remove_tool(self, number: int) -> None:
        """Take a tool out; later ones move up. Who rested in any must be roused."""
        for name in (
            "apparent_gravity",
            "_gravity_at_lock",
            "_tool_acceleration",
            "_tool_velocity",
        ):
            setattr(self, name, np.delete(getattr(self, name), number, axis=0))

    def request_wake(self, spheres: NDArray[np.float64]) -> None:
        """Wake before the next step what lies at some places [m], shape (n, 4): x, y, z, reach."""
        if len(spheres):
            self._wake_spheres.append(np.asarray(spheres, dtype=np.float64))

    def wake_disturbed(
        self, state: ParticleState, tools: ToolSet, ground: Ground, dt: float
    ) -> NDArray[np.int64]:
        """Wake who must not rest in the step to come, which `tools` have begun.

        Returns:
            Rows that woke.
        """
        self._update_apparent_gravity(tools, dt)
        changed = ground.pop_changed_cells()
        rows = np.flatnonzero(state.sleep_state)
        if rows.size == 0:
            self._wake_spheres.clear()
            return rows
        woken = np.zeros(rows.size, np.bool_)
        wake_load = np.linalg.norm(self.apparent_gravity - self._gravity_at_lock, axis=1) > (
            self._params.wake_gravity_change * self._params.gravity
        )
        if self._wake_spheres:
            wake_in_spheres(
                rows, state.position, state.radius, np.concatenate(self._wake_spheres), woken
            )
            self._wake_spheres.clear()
        if changed is not None:
            wake_on_changed_ground(
                rows, state.position, state.radius, state.sleep_state, changed, ground.frame, woken
            )
        moving = np.abs(tools.twist).max(axis=1, initial=0.0) > _MAX_REST_TWIST
        if moving.any():
            wake_near_moving_tools(
                dt, rows, state.position, state.radius, state.sleep_state, moving, tools.path[0],
                tools.twist, tools.sphere, tools.plates, tools.first,
                woken, wake_load,
            )  # fmt: skip
            self._wake_approaching_loads(
                state, tools, rows, moving & ~wake_load, dt, woken, wake_load
            )
        if wake_load.any():
            tool = state.sleep_state[rows].astype(np.int64) - 2
            woken |= (tool >= 0) & wake_load[tool]
        rows = rows[woken]
        self.wake_rows(state, rows)
        return rows

    @staticmethod
    def _wake_approaching_loads(  # type: ignore[no-untyped-def]
        state: ParticleState, tools: ToolSet, rows, checked_tools, dt: float, woken, wake_load
    ) -> None:
        """Wake the loads of the tools `asked` that come by soil which does not move with them."""
        loaded = np.unique(state.sleep_state[rows]) - 2
        for t in loaded[loaded >= 0]:
            if checked_tools[t]:
                wake_load[t] = load_approaches_soil(
                    dt, t, tools.path[0], tools.twist, rows, state.position, state.radius,
                    state.sleep_state, state.frozen, woken,
                )  # fmt: skip

    @staticmethod
    def wake_rows(state: ParticleState, rows: NDArray[np.integer]) -> None:
        """Let some move again, with the speed of what they lay in."""
        state.sleep_state[rows] = AWAKE
        state.sleep_timer[rows] = 0.0
        state.wake_reference[rows] = state.position[rows]

    def _update_apparent_gravity(self, tools: ToolSet, dt: float) -> None:
        """Gravity as it is felt in the tools, which accelerate and turn."""
        if tools.tools:
            _update_apparent_gravity(
                tools.path[0], tools.twist, tools.sphere, self._params.gravity, dt, self._tool_velocity,
                self._tool_acceleration, self.apparent_gravity,
            )  # fmt: skip

    def put_to_sleep(
        self,
        state: ParticleState,
        tools: ToolSet,
        rows: NDArray[np.int64],
        inside: NDArray[np.int64],
        step_contacts: StepContacts,
        dt: float,
    ) -> NDArray[np.int64]:
        """Let those rest that have been calm long enough, at the end of a step.

        Args:
            store: the particles.
            tools: before their `end`.
            rows: who is awake.
            inside: the tool in whose hull each of these is, -1 for none.
            touching: what touched what.
            dt: [s].

        Returns:
            Rows that fell asleep.
        """
        params = self._params
        if not params.allow_sleeping:
            return rows[:0]
        asleep = np.zeros(rows.size, np.bool_)
        _update_sleep_timers(
            rows, inside, state.position, state.velocity, state.angular_velocity, state.radius,
            state.contact_radius, tools.path[-1], tools.twist, params.sleep_speed,
            params.sleep_time, dt, state.sleep_timer, asleep,
        )  # fmt: skip
        if not asleep.any():
            return rows[:0]
        sleep_state = np.full(rows.size, ASLEEP_ON_MAP)
        for t in range(len(tools.tools)):
            rides, stays = self._classify_load(
                state, tools, rows, asleep, inside == t, step_contacts, t
            )
            sleep_state[rides] = t + 2
            asleep &= ~stays
        self._set_asleep(state, tools, rows[asleep], sleep_state[asleep])
        return rows[asleep]

    def _classify_load(  # type: ignore[no-untyped-def]
        self,
        state: ParticleState,
        tools: ToolSet,
        rows,
        sleep_ready,
        inside,
        step_contacts: StepContacts,
        t: int,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which of those `calm` ride in tool `t` from now on, and which must stay awake.

        What a tool holds must weigh on it, so that it rides or stays awake, but does not sleep on
        the map; soil that leans on something else too may, outside or in a still box.
        """
        tool_supported, otherwise_supported = (
            np.zeros(rows.size, np.bool_),
            np.zeros(rows.size, np.bool_),
        )
        loaded = bool((state.sleep_state == t + 2).any())
        tool_of_plate = tools.tool_of_plate[step_contacts.plate_contacts.plate]
        if not loaded and not (sleep_ready & inside).any() and not (tool_of_plate == t).any():
            return tool_supported, otherwise_supported
        trace_support(
            t, rows, sleep_ready, state.position, state.contact_radius, state.sleep_state, state.frozen,
            *step_contacts, tools.motion, tool_supported, otherwise_supported,
        )  # fmt: skip
        moving = np.abs(tools.twist[t]).max() > _MAX_REST_TWIST
        stays = inside & sleep_ready & (~otherwise_supported if not moving else True)
        if tools.is_digging[t] or moving:
            stays |= tool_supported & (inside | ~otherwise_supported)
        rides = tool_supported & ~otherwise_supported
        enough = _MIN_LOCKED_FRACTION * np.count_nonzero(inside)
        if not self._params.allow_load_locking or (
            not loaded and (not rides.any() or np.count_nonzero(rides & inside) < enough)
        ):
            return np.zeros_like(rides), stays | rides
        if not loaded:
            # The body's first: what it feels now is what it rests under.
            self._gravity_at_lock[t] = self.apparent_gravity[t]
        return rides, stays & ~rides

    @staticmethod
    def _set_asleep(  # type: ignore[no-untyped-def]
        state: ParticleState, tools: ToolSet, rows, sleep_state
    ) -> None:
        state.sleep_state[rows] = sleep_state
        state.velocity[rows[sleep_state == ASLEEP_ON_MAP]] = 0.0
        state.angular_velocity[rows] = 0.0
        for t in np.unique(sleep_state[sleep_state > ASLEEP_ON_MAP]) - 2:
            of = rows[sleep_state == t + 2]
            rotation, origin = tools.tools[t].end
            state.wake_reference[of] = (state.position[of] - origin) @ rotation

    def move_locked_loads(
        self,
        state: ParticleState,
        tools: ToolSet,
        locked_rows: NDArray[np.int64],
        tool: NDArray[np.int64],
    ) -> None:
        """Take what rides in tools along to their end poses; its weight and inertia act on them.

        Args:
            store: the particles.
            tools: before their `end`.
            riders, tool: who rides, one at least, and in which.
        """
        for t in np.unique(tool):
            load, centre = move_locked_loads(
                locked_rows, tool, t, tools.path[-1, t], tools.twist[t], state.wake_reference, state.mass,
                state.position, state.velocity, state.angular_velocity,
            )  # fmt: skip
            force = load * (self._gravity_vector - self._tool_acceleration[t])
            tools.wrench[t, :3] += force * tools.substeps
            tools.wrench[t, 3:] += np.cross(centre, force) * tools.substeps


@kernel
def _update_apparent_gravity(  # type: ignore[no-untyped-def]
    pose, twist, sphere, gravity, dt, before, acceleration, apparent_gravity
):
    """Smooth the acceleration of each tool's middle, and turn what is felt into its axes."""
    share = dt / (_ACCELERATION_FILTER_TIME + dt)
    for t in range(pose.shape[0]):
        p = pose[t]
        cx, cy, cz = sphere[t, 0], sphere[t, 1], sphere[t, 2]
        x = p[0] * cx + p[1] * cy + p[2] * cz
        y = p[3] * cx + p[4] * cy + p[5] * cz
        z = p[6] * cx + p[7] * cy + p[8] * cz
        ax, ay, az = twist[t, 3], twist[t, 4], twist[t, 5]
        speed = (
            twist[t, 0] + ay * z - az * y,
            twist[t, 1] + az * x - ax * z,
            twist[t, 2] + ax * y - ay * x,
        )
        for axis in range(3):
            now = (speed[axis] - before[t, axis]) / dt
            acceleration[t, axis] += share * (now - acceleration[t, axis])
            before[t, axis] = speed[axis]
        down = -gravity - acceleration[t, 2]
        for axis in range(3):
            apparent_gravity[t, axis] = (
                p[6 + axis] * down - p[axis] * acceleration[t, 0] - p[3 + axis] * acceleration[t, 1]
            )


@kernel
def select_moving_rows(sleep_state, frozen):  # type: ignore[no-untyped-def]
    """Rows that move by forces, rows that ride in tools, and the numbers of these tools."""
    rows, locked_rows = np.empty(sleep_state.size, np.int64), np.empty(sleep_state.size, np.int64)
    tool = np.empty(sleep_state.size, np.int64)
    free, riding = 0, 0
    for i in range(sleep_state.size):
        rows[free] = i
        free += sleep_state[i] == 0 and not frozen[i]
        locked_rows[riding], tool[riding] = i, sleep_state[i] - 2
        riding += sleep_state[i] > 1
    return rows[:free], locked_rows[:riding], tool[:riding]


@kernel
def _update_sleep_timers(  # type: ignore[no-untyped-def]
    rows, inside, position, velocity, angular_velocity, radius, contact_radius, pose, twist, speed, time, dt,
    sleep_timer, asleep,
):  # fmt: skip
    """Time who hardly moves, seen from what holds it; mark who has done so for `time` [s]."""
    for k in range(rows.size):
        i, t = rows[k], inside[k]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        sx, sy, sz = (
            np.float64(angular_velocity[i, 0]),
            np.float64(angular_velocity[i, 1]),
            np.float64(angular_velocity[i, 2]),
        )
        if t >= 0:
            ax, ay, az = twist[t, 3], twist[t, 4], twist[t, 5]
            qx = position[i, 0] - pose[t, 9]
            qy = position[i, 1] - pose[t, 10]
            qz = position[i, 2] - pose[t, 11]
            vx -= twist[t, 0] + ay * qz - az * qy
            vy -= twist[t, 1] + az * qx - ax * qz
            vz -= twist[t, 2] + ax * qy - ay * qx
            sx, sy, sz = sx - ax, sy - ay, sz - az
        r = np.float64(radius[i])
        motion = vx * vx + vy * vy + vz * vz + r * r * (sx * sx + sy * sy + sz * sz)
        if motion > speed * speed or contact_radius[i] < radius[i]:
            sleep_timer[i] = np.float32(0.0)
        else:
            sleep_timer[i] += np.float32(dt)
            asleep[k] = sleep_timer[i] >= time

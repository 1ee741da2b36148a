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

from machine_sim.ground import Ground
from machine_sim.jit import kernel
from machine_sim.particles.pairs.contacts import ContactBlocks
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.riding import carry, who_is_held
from machine_sim.particles.soil_contact import GroundContacts
from machine_sim.particles.store import ParticleStore
from machine_sim.particles.tool import RigidTool, ToolSet
from machine_sim.particles.waking import by_tools, meet, near_spots, on_changed
from machine_sim.particles.walls.listing import ListedWalls

__all__ = ["AWAKE", "ON_MAP", "Sleep", "Touching", "who_moves"]

AWAKE = 0
"""Values of the store's `resting`: awake, at rest on the map, or 2 + the number of the tool."""
ON_MAP = 1

_SMOOTHING = 0.06
"""Time over which the gravity felt in a tool is smoothed [s]: a drive's jerks are not shaking."""
_TOGETHER = 0.95
"""Part of the soil in a tool that must be calm before it rides as one body."""
_STILL = 1e-6
"""Motion of a tool that is none [m/s, rad/s]."""


class Touching(NamedTuple):
    """What touched what in a step.

    Attributes:
        contacts: between particles.
        walls: at plates.
        grounds: on the ground.
    """

    contacts: ContactBlocks
    walls: ListedWalls
    grounds: GroundContacts


class Sleep:
    """Who rests, and what wakes them.

    Attributes:
        felt: gravity felt in each tool [m/s^2], tool frame, smoothed, shape (tools, 3).
    """

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self._spots: list[NDArray[np.float64]] = []
        self._down = np.array([0.0, 0.0, -params.gravity])
        self.felt = np.zeros((0, 3))
        self._rested = np.zeros((0, 3))
        self._acceleration = np.zeros((0, 3))
        self._speed = np.zeros((0, 3))

    def add_tool(self, tool: RigidTool) -> None:
        """Take a tool in, behind the others, as if it had always been where it is."""
        felt = tool.start[0].T @ self._down
        self.felt = np.vstack([self.felt, felt])
        self._rested = np.vstack([self._rested, felt])
        self._acceleration = np.vstack([self._acceleration, np.zeros(3)])
        self._speed = np.vstack([self._speed, np.zeros(3)])

    def remove_tool(self, number: int) -> None:
        """Take a tool out; later ones move up. Who rested in any must be roused."""
        for name in ("felt", "_rested", "_acceleration", "_speed"):
            setattr(self, name, np.delete(getattr(self, name), number, axis=0))

    def disturb(self, spots: NDArray[np.float64]) -> None:
        """Wake before the next step what lies at some places [m], shape (n, 4): x, y, z, reach."""
        if len(spots):
            self._spots.append(np.asarray(spots, dtype=np.float64))

    def wake(
        self, store: ParticleStore, tools: ToolSet, ground: Ground, dt: float
    ) -> NDArray[np.int64]:
        """Wake who must not rest in the step to come, which `tools` have begun.

        Returns:
            Rows that woke.
        """
        self._feel(tools, dt)
        changed = ground.take_changes()
        rows = np.flatnonzero(store.resting)
        if rows.size == 0:
            self._spots.clear()
            return rows
        woken = np.zeros(rows.size, np.bool_)
        met = np.linalg.norm(self.felt - self._rested, axis=1) > (
            self._params.wake_tilt * self._params.gravity
        )
        if self._spots:
            near_spots(rows, store.position, store.radius, np.concatenate(self._spots), woken)
            self._spots.clear()
        if changed is not None:
            on_changed(
                rows, store.position, store.radius, store.resting, changed, ground.frame, woken
            )
        moving = np.abs(tools.twist).max(axis=1, initial=0.0) > _STILL
        if moving.any():
            by_tools(
                dt, rows, store.position, store.radius, store.resting, moving, tools.path[0],
                tools.twist, tools.sphere, tools.plates, tools.first,
                woken, met,
            )  # fmt: skip
            self._meet(store, tools, rows, moving & ~met, dt, woken, met)
        if met.any():
            tool = store.resting[rows].astype(np.int64) - 2
            woken |= (tool >= 0) & met[tool]
        rows = rows[woken]
        self.rouse(store, rows)
        return rows

    @staticmethod
    def _meet(  # type: ignore[no-untyped-def]
        store: ParticleStore, tools: ToolSet, rows, asked, dt: float, woken, met
    ) -> None:
        """Wake the loads of the tools `asked` that come by soil which does not move with them."""
        loaded = np.unique(store.resting[rows]) - 2
        for t in loaded[loaded >= 0]:
            if asked[t]:
                met[t] = meet(
                    dt, t, tools.path[0], tools.twist, rows, store.position, store.radius,
                    store.resting, store.frozen, woken,
                )  # fmt: skip

    @staticmethod
    def rouse(store: ParticleStore, rows: NDArray[np.integer]) -> None:
        """Let some move again, with the speed of what they lay in."""
        store.resting[rows] = AWAKE
        store.calm_time[rows] = 0.0
        store.place[rows] = store.position[rows]

    def _feel(self, tools: ToolSet, dt: float) -> None:
        """Gravity as it is felt in the tools, which accelerate and turn."""
        if tools.tools:
            _feel(
                tools.path[0], tools.twist, tools.sphere, self._params.gravity, dt, self._speed,
                self._acceleration, self.felt,
            )  # fmt: skip

    def fall_asleep(
        self,
        store: ParticleStore,
        tools: ToolSet,
        rows: NDArray[np.int64],
        inside: NDArray[np.int64],
        touching: Touching,
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
        if not params.sleeping:
            return rows[:0]
        asleep = np.zeros(rows.size, np.bool_)
        _calm(
            rows, inside, store.position, store.velocity, store.spin, store.radius,
            store.contact_radius, tools.path[-1], tools.twist, params.sleep_speed,
            params.sleep_time, dt, store.calm_time, asleep,
        )  # fmt: skip
        if not asleep.any():
            return rows[:0]
        resting = np.full(rows.size, ON_MAP)
        for t in range(len(tools.tools)):
            rides, stays = self._sort_load(store, tools, rows, asleep, inside == t, touching, t)
            resting[rides] = t + 2
            asleep &= ~stays
        self._lay_down(store, tools, rows[asleep], resting[asleep])
        return rows[asleep]

    def _sort_load(  # type: ignore[no-untyped-def]
        self, store: ParticleStore, tools: ToolSet, rows, calm, inside, touching: Touching, t: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which of those `calm` ride in tool `t` from now on, and which must stay awake.

        What a tool holds must weigh on it, so that it rides or stays awake, but does not sleep on
        the map; soil that leans on something else too may, outside or in a still box.
        """
        held, grounded = np.zeros(rows.size, np.bool_), np.zeros(rows.size, np.bool_)
        loaded = bool((store.resting == t + 2).any())
        owner = tools.owner[touching.walls.plate]
        if not loaded and not (calm & inside).any() and not (owner == t).any():
            return held, grounded
        who_is_held(
            t, rows, calm, store.position, store.contact_radius, store.resting, store.frozen,
            *touching, tools.motion, held, grounded,
        )  # fmt: skip
        moving = np.abs(tools.twist[t]).max() > _STILL
        stays = inside & calm & (~grounded if not moving else True)
        if tools.digs[t] or moving:
            stays |= held & (inside | ~grounded)
        rides = held & ~grounded
        enough = _TOGETHER * np.count_nonzero(inside)
        if not self._params.carried or (
            not loaded and (not rides.any() or np.count_nonzero(rides & inside) < enough)
        ):
            return np.zeros_like(rides), stays | rides
        if not loaded:
            # The body's first: what it feels now is what it rests under.
            self._rested[t] = self.felt[t]
        return rides, stays & ~rides

    @staticmethod
    def _lay_down(  # type: ignore[no-untyped-def]
        store: ParticleStore, tools: ToolSet, rows, resting
    ) -> None:
        store.resting[rows] = resting
        store.velocity[rows[resting == ON_MAP]] = 0.0
        store.spin[rows] = 0.0
        for t in np.unique(resting[resting > ON_MAP]) - 2:
            of = rows[resting == t + 2]
            rotation, origin = tools.tools[t].end
            store.place[of] = (store.position[of] - origin) @ rotation

    def carry(
        self,
        store: ParticleStore,
        tools: ToolSet,
        riders: NDArray[np.int64],
        tool: NDArray[np.int64],
    ) -> None:
        """Take what rides in tools along to their end poses; its weight and inertia act on them.

        Args:
            store: the particles.
            tools: before their `end`.
            riders, tool: who rides, one at least, and in which.
        """
        for t in np.unique(tool):
            load, centre = carry(
                riders, tool, t, tools.path[-1, t], tools.twist[t], store.place, store.mass,
                store.position, store.velocity, store.spin,
            )  # fmt: skip
            force = load * (self._down - self._acceleration[t])
            tools.wrench[t, :3] += force * tools.substeps
            tools.wrench[t, 3:] += np.cross(centre, force) * tools.substeps


@kernel
def _feel(pose, twist, sphere, gravity, dt, before, acceleration, felt):  # type: ignore[no-untyped-def]
    """Smooth the acceleration of each tool's middle, and turn what is felt into its axes."""
    share = dt / (_SMOOTHING + dt)
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
            felt[t, axis] = (
                p[6 + axis] * down - p[axis] * acceleration[t, 0] - p[3 + axis] * acceleration[t, 1]
            )


@kernel
def who_moves(resting, frozen):  # type: ignore[no-untyped-def]
    """Rows that move by forces, rows that ride in tools, and the numbers of these tools."""
    rows, riders = np.empty(resting.size, np.int64), np.empty(resting.size, np.int64)
    tool = np.empty(resting.size, np.int64)
    free, riding = 0, 0
    for i in range(resting.size):
        rows[free] = i
        free += resting[i] == 0 and not frozen[i]
        riders[riding], tool[riding] = i, resting[i] - 2
        riding += resting[i] > 1
    return rows[:free], riders[:riding], tool[:riding]


@kernel
def _calm(  # type: ignore[no-untyped-def]
    rows, inside, position, velocity, spin, radius, contact_radius, pose, twist, speed, time, dt,
    calm_time, asleep,
):  # fmt: skip
    """Time who hardly moves, seen from what holds it; mark who has done so for `time` [s]."""
    for k in range(rows.size):
        i, t = rows[k], inside[k]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        sx, sy, sz = np.float64(spin[i, 0]), np.float64(spin[i, 1]), np.float64(spin[i, 2])
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
            calm_time[i] = np.float32(0.0)
        else:
            calm_time[i] += np.float32(dt)
            asleep[k] = calm_time[i] >= time

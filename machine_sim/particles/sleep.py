"""Rest: particles at rest are left alone, and soil at rest in a tool rides along as one body.

A particle *rests* when it has hardly moved for a while, seen from what it lies in: the map, or a
tool that holds it. It then moves only with that, costs next to nothing, and is a fixed obstacle to
those awake. It wakes when something changes for it:

- a particle that is awake hits it, or one that supported it is gone
- the ground under it changes, or a tool comes by
- the tool it lies in is tilted or shaken: the gravity felt in the tool has left that under which
  the soil came to rest by more than a set part. Until then the soil is carried as one body, and its
  weight and inertia act on the tool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground import Ground
from machine_sim.particles.jit import kernel
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.plates import closest_in_polygon, plate_coordinates
from machine_sim.particles.store import ParticleStore
from machine_sim.particles.tool import ToolSet
from machine_sim.particles.walls import to_tool

__all__ = ["AWAKE", "ON_MAP", "Sleep", "wake_touched"]

AWAKE = 0
"""Values of the store's `resting`: awake, at rest on the map, or 2 + the number of the tool."""
ON_MAP = 1

_SMOOTHING = 0.06
"""Time over which the gravity felt in a tool is smoothed [s]: a drive's jerks are not shaking."""
_TOGETHER = 0.95
"""Part of the soil in a tool that must be calm before it rides as one body."""
_BESIDE = 0.5
"""How close a tool that moves comes by to wake a particle, in radii beyond touching."""
_AHEAD = 4.0
"""And in its ways of a step: a fast tool would step over small ones asleep, or press those it woke
against others that do not give way yet."""


class Sleep:
    """Who rests, and what wakes them.

    Attributes:
        felt: gravity felt in each tool [m/s^2], tool frame, smoothed, shape (tools, 3).
    """

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self._spots: list[NDArray[np.float64]] = []
        self.reset_tools(ToolSet(params.substeps))

    def reset_tools(self, tools: ToolSet) -> None:
        """Begin anew with other tools: as if each had always been where it is."""
        down = np.array([0.0, 0.0, -self._params.gravity])
        count = len(tools.tools)
        self.felt = np.array([tool.start[0].T @ down for tool in tools.tools]).reshape(count, 3)
        self._acceleration = np.zeros((count, 3))
        self._speed: NDArray[np.float64] | None = None
        self._rested = self.felt.copy()

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
        shaken = np.linalg.norm(self.felt - self._rested, axis=1) > (
            self._params.wake_tilt * self._params.gravity
        )
        if shaken.any():
            tool = store.resting[rows].astype(np.int64) - 2
            woken |= (tool >= 0) & shaken[tool]
        if self._spots:
            _near_spots(rows, store.position, store.radius, np.concatenate(self._spots), woken)
            self._spots.clear()
        if changed is not None:
            _on_changed(rows, store.position, store.resting, changed, ground.frame, woken)
        moving = np.abs(tools.twist).max(axis=1, initial=0.0) > 1e-6
        if moving.any():
            _by_tools(
                dt, rows, store.position, store.radius, store.resting, moving, tools.path[0],
                tools.twist, tools.sphere, tools.frame, tools.corner, tools.corners, tools.first,
                woken,
            )  # fmt: skip
        rows = rows[woken]
        self.rouse(store, rows)
        return rows

    @staticmethod
    def rouse(store: ParticleStore, rows: NDArray[np.integer]) -> None:
        """Let some move again, with the speed of what they lay in."""
        store.resting[rows] = AWAKE
        store.calm_time[rows] = 0.0

    def _feel(self, tools: ToolSet, dt: float) -> None:
        """Gravity as it is felt in the tools, which accelerate and turn."""
        if len(self.felt) != len(tools.tools):
            self.reset_tools(tools)
        if not tools.tools:
            return
        down = np.array([0.0, 0.0, -self._params.gravity])
        speed = np.zeros((len(tools.tools), 3))
        for t, tool in enumerate(tools.tools):
            (x, y, z), (ax, ay, az) = tool.start[0] @ tool.centre, tools.twist[t, 3:]
            speed[t] = ay * z - az * y, az * x - ax * z, ax * y - ay * x
        speed += tools.twist[:, :3]
        before = speed if self._speed is None else self._speed
        self._speed = speed
        share = dt / (_SMOOTHING + dt)
        self._acceleration += share * ((speed - before) / dt - self._acceleration)
        for t, tool in enumerate(tools.tools):
            self.felt[t] = tool.start[0].T @ (down - self._acceleration[t])

    def fall_asleep(
        self,
        store: ParticleStore,
        tools: ToolSet,
        rows: NDArray[np.int64],
        inside: NDArray[np.int64],
        dt: float,
    ) -> NDArray[np.int64]:
        """Let those rest that have been calm long enough, at the end of a step.

        Args:
            store: the particles.
            tools: before their `end`.
            rows: who is awake.
            inside: the tool that holds each of these, -1 for none.
            dt: [s].

        Returns:
            Rows that fell asleep.
        """
        params = self._params
        asleep = np.zeros(rows.size, np.bool_)
        _calm(
            rows, inside, store.position, store.velocity, store.spin, store.radius,
            store.contact_radius, tools.path[-1], tools.twist, params.sleep_speed,
            params.sleep_time if params.sleeping else np.inf, dt, store.calm_time, asleep,
        )  # fmt: skip
        for t in np.unique(inside[asleep]):
            if t >= 0:
                held = inside == t
                together = params.carried and asleep[held].mean() >= _TOGETHER
                if not together and not (store.resting == t + 2).any():
                    asleep[held] = False
        resting = inside[asleep] + 2
        rows = rows[asleep]
        if rows.size == 0:
            return rows
        for t in np.unique(resting[resting > ON_MAP]) - 2:
            if not (store.resting == t + 2).any():
                # The body's first: what it feels now is what it rests under.
                self._rested[t] = self.felt[t]
        store.resting[rows] = np.maximum(resting, ON_MAP)
        in_tool = resting > ON_MAP
        for t in np.unique(resting[in_tool]) - 2:
            of = rows[resting == t + 2]
            rotation, origin = tools.tools[t].end
            store.place[of] = (store.position[of] - origin) @ rotation
        store.velocity[rows[~in_tool]] = 0.0
        store.spin[rows] = 0.0
        return rows

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
            riders, tool: who rides, and in which.
        """
        down = np.array([0.0, 0.0, -self._params.gravity])
        for t in np.unique(tool):
            load, centre = _carry(
                riders, tool, t, tools.path[-1, t], tools.twist[t], store.place, store.mass,
                store.position, store.velocity, store.spin,
            )  # fmt: skip
            force = load * (down - self._acceleration[t])
            tools.wrench[t, :3] += force * tools.substeps
            tools.wrench[t, 3:] += np.cross(centre, force) * tools.substeps


@kernel
def _carry(riders, tool, number, pose, twist, place, mass, position, velocity, spin):  # type: ignore[no-untyped-def]
    """Take who rides in tool `number` along to its packed `pose`.

    Returns:
        Mass of these [kg], and their centre of mass from the origin of the tool's frame [m], map
        axes, shape (3,).
    """
    load, moment = 0.0, np.zeros(3)
    ax, ay, az = twist[3], twist[4], twist[5]
    for k in range(riders.size):
        if tool[k] != number:
            continue
        i = riders[k]
        px, py, pz = place[i, 0], place[i, 1], place[i, 2]
        x = pose[0] * px + pose[1] * py + pose[2] * pz
        y = pose[3] * px + pose[4] * py + pose[5] * pz
        z = pose[6] * px + pose[7] * py + pose[8] * pz
        position[i, 0], position[i, 1], position[i, 2] = pose[9] + x, pose[10] + y, pose[11] + z
        velocity[i, 0] = twist[0] + ay * z - az * y
        velocity[i, 1] = twist[1] + az * x - ax * z
        velocity[i, 2] = twist[2] + ax * y - ay * x
        spin[i, 0], spin[i, 1], spin[i, 2] = ax, ay, az
        m = np.float64(mass[i])
        load += m
        moment[0] += m * x
        moment[1] += m * y
        moment[2] += m * z
    return load, moment / load


@kernel
def _near_spots(rows, position, radius, spots, woken):  # type: ignore[no-untyped-def]
    """Mark whose surface is within reach of a spot."""
    low, high = np.full(3, 1e300), np.full(3, -1e300)
    for s in range(spots.shape[0]):
        for axis in range(3):
            low[axis] = min(low[axis], spots[s, axis] - spots[s, 3])
            high[axis] = max(high[axis], spots[s, axis] + spots[s, 3])
    for k in range(rows.size):
        i = rows[k]
        r = np.float64(radius[i])
        outside = False
        for axis in range(3):
            p = position[i, axis]
            outside |= p < low[axis] - r or p > high[axis] + r
        if outside or woken[k]:
            continue
        for s in range(spots.shape[0]):
            dx, dy = position[i, 0] - spots[s, 0], position[i, 1] - spots[s, 1]
            dz, near = position[i, 2] - spots[s, 2], r + spots[s, 3]
            if dx * dx + dy * dy + dz * dz < near * near:
                woken[k] = True
                break


@kernel
def _on_changed(rows, position, resting, changed, ground, woken):  # type: ignore[no-untyped-def]
    """Mark who lies on a column that changed, or that has one beside it that did."""
    last_row, last_col = changed.shape[0] - 2, changed.shape[1] - 2
    for k in range(rows.size):
        i = rows[k]
        if resting[i] != 1 or woken[k]:
            continue
        u = min(max(int((ground[0] - position[i, 0]) * ground[2]), 0), last_row)
        v = min(max(int((ground[1] - position[i, 1]) * ground[2]), 0), last_col)
        woken[k] = changed[u, v] | changed[u + 1, v] | changed[u, v + 1] | changed[u + 1, v + 1]


@kernel
def _by_tools(  # type: ignore[no-untyped-def]
    dt, rows, position, radius, resting, moving, pose, twist, sphere, frame, corner, corners, first,
    woken,
):  # fmt: skip
    """Mark whom a tool that moves comes by within `dt` [s], but for those who ride in it."""
    for k in range(rows.size):
        i = rows[k]
        if woken[k]:
            continue
        for t in range(moving.size):
            if not moving[t] or resting[i] == t + 2:
                continue
            qx, qy, qz = (
                position[i, 0] - pose[t, 9],
                position[i, 1] - pose[t, 10],
                position[i, 2] - pose[t, 11],
            )
            vx = twist[t, 0] + twist[t, 4] * qz - twist[t, 5] * qy
            vy = twist[t, 1] + twist[t, 5] * qx - twist[t, 3] * qz
            vz = twist[t, 2] + twist[t, 3] * qy - twist[t, 4] * qx
            ahead = _AHEAD * dt * np.sqrt(vx * vx + vy * vy + vz * vz)
            reach = (1.0 + _BESIDE) * radius[i] + ahead
            x, y, z = to_tool(pose[t], position[i, 0], position[i, 1], position[i, 2])
            dx, dy, dz = x - sphere[t, 0], y - sphere[t, 1], z - sphere[t, 2]
            if dx * dx + dy * dy + dz * dz > (sphere[t, 3] + reach) ** 2:
                continue
            for p in range(first[t], first[t + 1]):
                a, b, h = plate_coordinates(frame, p, x, y, z)
                if abs(h) > reach:
                    continue
                ca, cb, _ = closest_in_polygon(corner, corners, p, a, b)
                if (a - ca) ** 2 + (b - cb) ** 2 + h * h < reach * reach:
                    woken[k] = True
                    break


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


@kernel
def wake_touched(  # type: ignore[no-untyped-def]
    first, second, entry, begin, size, touching, body, resting, speed, calm_time
):
    """Wake who is touched by one that moves faster than `speed` [m/s] relative to it.

    Args:
        first, second, entry, begin, size: of `ContactTable`.
        touching: of the pair table, after the step.
        body: records at the end of the step.
        resting, calm_time: of the store; updated.

    Returns:
        How many woke.
    """
    woken = 0
    for part in range(begin.size):
        for c in range(begin[part], begin[part] + size[part]):
            i, j = first[c], second[c]
            if (resting[i] == 0) == (resting[j] == 0) or touching[entry[c]] == 0:
                continue
            x, y, z = body[j, 4] - body[i, 4], body[j, 5] - body[i, 5], body[j, 6] - body[i, 6]
            if x * x + y * y + z * z > speed * speed:
                k = i if resting[i] != 0 else j
                resting[k] = 0
                calm_time[k] = np.float32(0.0)
                woken += 1
    return woken

"""Pending soil: excavated soil, credited column by column, until it becomes particles.

An EXCAVATE row is a parcel at the position of its soil. Parcels of one column accumulate until they
reach the volume of a particle, which is then released at the position of the newest parcel, moved
inside the tool. When a column gets no more parcels for `_MAX_IDLE_TICKS`, its remainder is merged
with that of other columns, and released at the position of the last of them. Soil held back by the
limit per tick or by a full engine is released as soon as there is capacity, in particles of the
usual size; a rest below a quarter of a particle stays pending until the tool digs again.

Parcels of one column take the soil id of the newest, and remainders of several that of the larger.
They take the mean moisture: their volumes and their *water*, volume times moisture, are added. A
particle takes water in proportion to its volume. Its moisture is rounded to a whole per cent, up or
down, whichever keeps the accumulated rounding error smaller: the water of all particles differs
from the water excavated by at most half a per cent of one particle. Soil of uniform moisture keeps
it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.box import Vec3
from machine_sim.machine.tools.shapes import CuttingShape
from msg_bridge.contract.rows import MAX_ROW_VOLUME, Rows
from msg_bridge.kernels import kernel

__all__ = ["PendingSoil", "coarse_graining_factor"]

_MAX_IDLE_TICKS = 5
"""Ticks without a new parcel after which a column's remainder is released."""

_COARSENING_ONSET = 0.5
"""Fraction of the engine's capacity above which released particles become larger."""
_MAX_COARSE_GRAINING = 8.0
"""Coarse-graining factor of a full engine."""

_MIN_VOLUME_FRACTION = 0.25
"""Minimum volume of a particle as a fraction of the nominal volume."""

_CLEARANCE = 0.02
"""Minimum distance of any released particle from the tool's plates [m]."""


def coarse_graining_factor(count: int, capacity: int) -> float:
    """Return the volume of a particle over the nominal volume: 1 to 8 as the engine fills up.

    Excavation continues with fewer and larger particles.

    Args:
        count: present number of particles.
        capacity: maximum number of particles.
    """
    excess = (count / capacity - _COARSENING_ONSET) / (1.0 - _COARSENING_ONSET)
    return 1.0 + (_MAX_COARSE_GRAINING - 1.0) * min(max(excess, 0.0), 1.0)


@dataclass(slots=True)
class _Parcel:
    """Pending soil of one column.

    Attributes:
        volume: bank volume [mm^3].
        water: volume times moisture [mm^3 %].
        particle_volume: volume of the next particle without coarse-graining [mm^3].
        soil: soil id.
        point: position x, y, z of the newest row [m], tool frame, so that it moves with the tool.
        tick: number of the tick of the newest row.
    """

    volume: int
    water: int
    particle_volume: int
    soil: int
    point: list[float]
    tick: int

    def withdraw(self, volume: int) -> int:
        """Remove `volume` [mm^3], at most that of the parcel, and return its water [mm^3 %]."""
        water = self.water * volume // self.volume
        self.volume -= volume
        self.water -= water
        return water


@dataclass
class _Batch:
    """Particles to insert, one entry each: volumes [mm^3], points in the tool frame [m]."""

    volumes: list[int] = field(default_factory=list)
    points: list[list[float]] = field(default_factory=list)
    soils: list[int] = field(default_factory=list)
    moistures: list[int] = field(default_factory=list)


class PendingSoil:
    """Account of the soil that one tool has excavated and that is not yet particles."""

    def __init__(
        self, shape: CuttingShape, rng: np.random.Generator, *, nominal_mm3: int, max_per_tick: int
    ) -> None:
        """
        Args:
            shape: shape of the tool.
            rng: generator that scatters particles released at one point.
            nominal_mm3: nominal bank volume of a particle [mm^3].
            max_per_tick: maximum number of particles released in one tick.
        """
        self._shape = shape
        self._rng = rng
        self._nominal_mm3 = nominal_mm3
        self._max_per_tick = max_per_tick
        self._parcels: dict[tuple[int, int], _Parcel] = {}
        self._remainder = _Parcel(0, 0, nominal_mm3, 0, [0.0, 0.0, 0.0], 0)  # of idle columns
        self._total_mm3 = 0
        self._rounding_error = 0  # water missing in particles [mm^3 %]; negative: excess

    @property
    def total_mm3(self) -> int:
        """Pending bank volume [mm^3]."""
        return self._total_mm3

    @property
    def state(self) -> NDArray[np.generic]:
        """Values for the state hash."""
        return np.array([self.total_mm3])

    @property
    def rounding_error(self) -> int:
        """Water missing in the particles released so far [mm^3 %]; negative: excess."""
        return self._rounding_error

    @property
    def points(self) -> list[list[float]]:
        """Positions x, y, z of the parcels [m], tool frame."""
        return [parcel.point for parcel in self._parcels.values()]

    @property
    def accounted_water(self) -> int:
        """Water (volume times moisture) of the pending soil, plus `rounding_error` [mm^3 %]."""
        parcels = sum(parcel.water for parcel in self._parcels.values())
        return self._rounding_error + self._remainder.water + parcels

    def continue_from(self, other: PendingSoil) -> None:
        """Take the soil of another account, and its random numbers."""
        self._parcels = {key: replace(each) for key, each in other._parcels.items()}
        self._remainder = replace(other._remainder)
        self._rounding_error, self._rng = other._rounding_error, other._rng
        self._total_mm3 = other._total_mm3

    def receive(self, excavated: Rows, pose: Pose, tick: int) -> None:
        """Credit CONVERSION rows of the kind EXCAVATE of a tool at a pose in a tick."""
        local_points = np.empty((excavated.size, 3))
        _fill_local_points(excavated, *pose, local_points)
        points = local_points.tolist()
        columns = (
            excavated[name].tolist() for name in ("row", "col", "volume_mm3", "moisture", "soil")
        )
        for row, col, volume, moisture, soil, point in zip(*columns, points, strict=True):
            self._total_mm3 += volume
            parcel = self._parcels.get((row, col))
            if parcel is None:
                parcel = _Parcel(0, 0, self._nominal_mm3, 0, point, tick)
                self._parcels[row, col] = parcel
            parcel.volume += volume
            parcel.water += volume * moisture
            parcel.soil, parcel.point, parcel.tick = soil, point, tick

    def discard(self, volume: int) -> int:
        """Remove up to a volume [mm^3] of pending soil, the oldest first; return what was removed.

        For soil that became particles in ticks that are not simulated again.
        """
        rest = volume
        for parcel in (self._remainder, *self._parcels.values()):
            part = min(rest, parcel.volume)
            if part:
                parcel.withdraw(part)
                rest -= part
        self._total_mm3 -= volume - rest
        return volume - rest

    def clear(self) -> None:
        """Remove all pending soil."""
        self._parcels.clear()
        self._total_mm3 = 0
        self._remainder = _Parcel(0, 0, self._nominal_mm3, 0, [0.0, 0.0, 0.0], 0)

    def release(
        self,
        particles: SoilEngine,
        pose: Pose,
        tick: int,
        release_twist: tuple[Vec3, Vec3] | None = None,
    ) -> int:
        """Release pending soil as particles, at most as many as the limit per tick.

        Args:
            particles: engine that the particles are inserted into.
            pose: pose of the tool's non-spinning frame.
            tick: number of the tick.
            release_twist: velocity [m/s] and angular velocity [rad/s] of the tool that particles
                start with; None: they start at rest.

        Returns:
            Number of particles released.

        Raises:
            ParticleError: the engine rejects the particles; their soil stays pending.
        """
        if self._total_mm3 == 0 and not self._parcels:
            return 0
        batch = _Batch()
        try:
            self._fill_batch(batch, particles, tick)
            if batch.volumes:
                self._insert_particles(particles, pose, batch, release_twist)
        except Exception:
            self._restore(batch)
            raise
        return len(batch.volumes)

    def _fill_batch(self, batch: _Batch, particles: SoilEngine, tick: int) -> None:
        """Withdraw particles from parcels up to the limit of the tick and the free capacity."""
        max_count = min(self._max_per_tick, particles.free_capacity)
        for key, parcel in list(self._parcels.items()):
            # Most parcels hold less than one particle, and have received soil lately.
            is_small = parcel.volume < parcel.particle_volume and parcel.volume < MAX_ROW_VOLUME
            if is_small and tick - parcel.tick <= _MAX_IDLE_TICKS:
                continue
            min_volume = min(parcel.particle_volume, MAX_ROW_VOLUME)
            while parcel.volume >= min_volume and len(batch.volumes) < max_count:
                volume = self._next_volume(batch, parcel, particles)
                if parcel.volume < volume:
                    break
                self._append_particle(batch, parcel, volume, parcel.withdraw(volume))
                parcel.particle_volume = self._draw_volume(particles.soils[parcel.soil].size_spread)
                min_volume = min(parcel.particle_volume, MAX_ROW_VOLUME)
            if parcel.volume < parcel.particle_volume and tick - parcel.tick > _MAX_IDLE_TICKS:
                self._add_to_remainder(parcel)
                del self._parcels[key]
                self._release_remainder(batch, particles, max_count)
        # The remainder may have found no capacity in an earlier tick.
        self._release_remainder(batch, particles, max_count)

    @staticmethod
    def _next_volume(batch: _Batch, parcel: _Parcel, particles: SoilEngine) -> int:
        """Return the volume of the next particle of a parcel [mm^3], coarse-grained."""
        factor = coarse_graining_factor(
            particles.count + len(batch.volumes), particles.params.capacity
        )
        return min(int(factor * parcel.particle_volume), MAX_ROW_VOLUME)

    def _add_to_remainder(self, parcel: _Parcel) -> None:
        """Merge the rest of a parcel into the common remainder, with the kind of the larger one."""
        if parcel.volume == 0:  # all of it became particles
            return
        rest = self._remainder
        if parcel.soil == rest.soil or parcel.volume > rest.volume:
            rest.soil, rest.particle_volume = parcel.soil, parcel.particle_volume
        rest.volume += parcel.volume
        rest.water += parcel.water
        rest.point = parcel.point

    def _release_remainder(self, batch: _Batch, particles: SoilEngine, max_count: int) -> None:
        """Withdraw particles from the remainder; none leaves a rest below the minimum volume."""
        rest, min_volume = self._remainder, _MIN_VOLUME_FRACTION * self._nominal_mm3
        while rest.volume >= min_volume and len(batch.volumes) < max_count:
            volume = self._next_volume(batch, rest, particles)
            if rest.volume < volume + min_volume:
                volume = min(rest.volume, MAX_ROW_VOLUME)
            self._append_particle(batch, rest, volume, rest.withdraw(volume))

    def _restore(self, batch: _Batch) -> None:
        """Return the volume and water of rejected particles to the remainder."""
        volume = sum(batch.volumes)
        self._total_mm3 += volume
        self._remainder.volume += volume
        pairs = zip(batch.volumes, batch.moistures, strict=True)
        self._remainder.water += sum(volume * moisture for volume, moisture in pairs)

    def _append_particle(self, batch: _Batch, parcel: _Parcel, volume: int, water: int) -> None:
        """Append a particle with the soil and at the point of a parcel."""
        moisture, excess = divmod(water, volume)
        if excess:
            moisture += 2 * (self._rounding_error + excess) > volume
        self._rounding_error += water - moisture * volume
        self._total_mm3 -= volume
        batch.volumes.append(volume)
        batch.points.append(parcel.point)
        batch.soils.append(parcel.soil)
        batch.moistures.append(moisture)

    def _draw_volume(self, spread: float) -> int:
        """Return a particle volume [mm^3], uniform in nominal * (1 - spread) to (1 + spread)."""
        if spread == 0.0:
            return self._nominal_mm3
        return round(self._nominal_mm3 * (1.0 + spread * self._rng.uniform(-1.0, 1.0)))

    def _insert_particles(
        self,
        particles: SoilEngine,
        pose: Pose,
        batch: _Batch,
        release_twist: tuple[Vec3, Vec3] | None,
    ) -> None:
        """Insert the particles of a batch into the engine; arguments as for `release`."""
        rotation, origin = pose
        volume = np.array(batch.volumes, dtype=np.int64)
        soil, moisture = (np.array(each, dtype=np.uint8) for each in (batch.soils, batch.moistures))
        clearance = max(_CLEARANCE, particles.release_clearance(volume, soil, moisture))
        # Particles of one point scatter over the volume of their soil.
        spread = 0.5 * np.cbrt(volume * 1e-9)[:, None]
        local = np.array(batch.points) + spread * self._rng.uniform(-1.0, 1.0, (volume.size, 3))
        local = self._shape.release_points(local, clearance, rotation[2])
        lever_arm = local @ rotation.T
        if release_twist is None:
            velocity = np.zeros_like(local)
        else:
            velocity = _point_velocities(lever_arm, *release_twist)
        particles.add(
            lever_arm + origin,
            velocity,
            volume,
            soil,
            moisture,
        )


@kernel
def _fill_local_points(rows, rotation, origin, points):  # type: ignore[no-untyped-def]
    """Fill an array with the positions of rows in the frame of a pose [m], shape (n, 3).

    Component by component: the last bits of a matrix product depend on its number of rows.
    """
    for i in range(rows.size):
        a, b, c = rows[i].x - origin[0], rows[i].y - origin[1], rows[i].z - origin[2]
        for k in range(3):
            points[i, k] = a * rotation[0, k] + b * rotation[1, k] + c * rotation[2, k]


@kernel
def _point_velocities(lever_arm, velocity, angular_velocity):  # type: ignore[no-untyped-def]
    """Return the velocities of points of a rigid body [m/s], shape (n, 3).

    Args:
        lever_arm: points relative to the origin of the body [m], map axes, shape (n, 3).
        velocity, angular_velocity: of the body at its origin [m/s], [rad/s].
    """
    velocities = np.empty_like(lever_arm)
    (vx, vy, vz), (wx, wy, wz) = velocity, angular_velocity
    for i in range(len(lever_arm)):
        x, y, z = lever_arm[i, 0], lever_arm[i, 1], lever_arm[i, 2]
        velocities[i, 0] = vx + (wy * z - wz * y)
        velocities[i, 1] = vy + (wz * x - wx * z)
        velocities[i, 2] = vz + (wx * y - wy * x)
    return velocities

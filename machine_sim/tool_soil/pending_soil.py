"""Release: excavated soil, credited column by column, becomes particles where it was cut.

The pending account. A conversion row is a parcel at the place its soil stood; parcels of one
column gather until they make a particle of the nominal volume, which then appears at the place of
the newest of them, inside the tool. What a column has left when no more comes, too little for a
particle, gathers with that of others, and comes out where the last of them was. What a tick's limit
or a full engine keeps back comes out as soon as there is room, in particles no larger than at any
other time; the last of it, less than a quarter of a particle, stays pending until the tool digs
again.

Parcels that gather become of the kind of the newest, and as moist as all of them together: their
volumes and their *water*, volume times moisture, add up. A particle gets water by its volume. Its
moisture is a whole per cent, the one above or below that, whichever leaves the smaller sum of all
that was rounded off so far: what particles carry away differs from what was dug by half a per cent
of one of them, at most. Soil of one moisture keeps it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.shapes import CuttingShape
from msg_bridge.contract.rows import MAX_ROW_VOLUME, ConversionKind, Rows

__all__ = ["PendingSoil", "coarse_graining_factor"]

_MAX_IDLE_TICKS = 5
"""Ticks without a new parcel after which a column's remainder is released."""

_COARSENING_ONSET = 0.5
"""Part of the engine's capacity from which on particles are made larger."""
_MAX_COARSE_GRAINING = 8.0
"""Volume of a particle when the engine is full, over that when it is not."""

_MIN_VOLUME_FRACTION = 0.25
"""Smallest particle worth making, in parts of the nominal volume."""

_CLEARANCE = 0.02
"""Distance from the tool's plates at which a particle may appear [m]."""

Vector = NDArray[np.float64]


def coarse_graining_factor(count: int, capacity: int) -> float:
    """Volume of a particle over the nominal one: 1, and more where the engine fills up.

    Soil goes on coming out of the ground then, in fewer and larger parts.

    Args:
        count: particles there are.
        capacity: most that there can be.
    """
    crowd = (count / capacity - _COARSENING_ONSET) / (1.0 - _COARSENING_ONSET)
    return 1.0 + (_MAX_COARSE_GRAINING - 1.0) * min(max(crowd, 0.0), 1.0)


@dataclass
class _Parcel:
    """Soil of one column, waiting; `place` is in the tool frame, so that it moves with it."""

    volume: int
    water: int  # [mm^3 %]
    size: int  # of the next particle
    soil: int
    place: Vector
    tick: int

    def withdraw(self, volume: int) -> int:
        """Take out `volume`, which there is; returns the water in it."""
        water = self.water * volume // self.volume
        self.volume -= volume
        self.water -= water
        return water


@dataclass
class _Batch:
    """Particles to be made, one entry each; places are in the tool frame."""

    volumes: list[int] = field(default_factory=list)
    places: list[Vector] = field(default_factory=list)
    soils: list[int] = field(default_factory=list)
    moistures: list[int] = field(default_factory=list)


class PendingSoil:
    """Parcels received and not yet turned into particles."""

    def __init__(
        self, shape: CuttingShape, rng: np.random.Generator, *, nominal_mm3: int, max_per_tick: int
    ) -> None:
        """
        Args:
            shape: of the tool that cuts.
            rng: scatters particles that appear at one place.
            nominal_mm3: bank volume of a particle [mm^3].
            per_tick: particles released in one tick, at most; the rest waits.
        """
        self._shape = shape
        self._rng = rng
        self._nominal_mm3 = nominal_mm3
        self._max_per_tick = max_per_tick
        self._parcels: dict[tuple[int, int], _Parcel] = {}
        self._remainder = _Parcel(0, 0, nominal_mm3, 0, np.zeros(3), 0)  # of columns left behind
        self._rounding_error = 0  # water that particles have got too little of; below 0 too much

    @property
    def total_mm3(self) -> int:
        """Bank volume waiting [mm^3]."""
        return self._remainder.volume + sum(parcel.volume for parcel in self._parcels.values())

    @property
    def state(self) -> NDArray[np.generic]:
        """Values for the state hash."""
        return np.array([self.total_mm3])

    @property
    def water(self) -> int:
        """Volume times moisture [mm^3 %] of what waits, with what rounding has kept back so far."""
        parcels = sum(parcel.water for parcel in self._parcels.values())
        return self._rounding_error + self._remainder.water + parcels

    def receive(self, conversions: Rows, pose: Pose, tick: int) -> None:
        """Credit the EXCAVATE rows among `conversions`; the tool stands at `pose`."""
        rows = conversions[conversions["kind"] == ConversionKind.EXCAVATE]
        rotation, origin = pose
        x, y, z = (rows[name] - origin[k] for k, name in enumerate("xyz"))
        # Column by column, not as a matrix: a product's last bits depend on how many rows it has.
        places = np.column_stack([x * a + y * b + z * c for a, b, c in rotation.T.tolist()])
        columns = (rows[name].tolist() for name in ("row", "col", "volume_mm3", "moisture", "soil"))
        for row, col, volume, moisture, soil, place in zip(*columns, places, strict=True):
            parcel = self._parcels.get((row, col))
            if parcel is None:
                parcel = _Parcel(0, 0, self._nominal_mm3, 0, place, tick)
                self._parcels[row, col] = parcel
            parcel.volume += volume
            parcel.water += volume * moisture
            parcel.soil, parcel.place, parcel.tick = soil, place, tick

    def release(
        self,
        particles: SoilEngine,
        pose: Pose,
        tick: int,
        release_twist: tuple[Vector, Vector] | None = None,
    ) -> int:
        """Turn parcels into particles, at most as many as one tick may have.

        Args:
            particles: the engine that takes them.
            pose: of the tool's frame, as parcels know it.
            tick: number of the tick.
            thrown: velocity of the tool [m/s] and angular [rad/s] that they come loose with; at
                rest if not given.

        Returns:
            How many were made.

        Raises:
            ParticleError: the engine takes none of them; all of it is pending still.
        """
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
        """Take particles out of parcels while there is room for them."""
        room = min(self._max_per_tick, particles.free_capacity)
        for key, parcel in list(self._parcels.items()):
            # Most have less than any particle takes: no need to ask how full the engine is.
            least = min(parcel.size, MAX_ROW_VOLUME)
            while parcel.volume >= least and len(batch.volumes) < room:
                volume = self._next_volume(batch, parcel, particles)
                if parcel.volume < volume:
                    break
                self._append_particle(batch, parcel, volume, parcel.withdraw(volume))
                parcel.size = self._draw_volume(particles.soils[parcel.soil].size_spread)
                least = min(parcel.size, MAX_ROW_VOLUME)
            if parcel.volume < parcel.size and tick - parcel.tick > _MAX_IDLE_TICKS:
                self._add_to_remainder(parcel)
                del self._parcels[key]
                self._release_remainder(batch, particles, room)
        # Also where no column is left behind now: there may have been no room before.
        self._release_remainder(batch, particles, room)

    @staticmethod
    def _next_volume(batch: _Batch, parcel: _Parcel, particles: SoilEngine) -> int:
        """Volume of the next particle of a parcel [mm^3], as full as the engine is."""
        coarse = coarse_graining_factor(
            particles.count + len(batch.volumes), particles.params.capacity
        )
        return min(int(coarse * parcel.size), MAX_ROW_VOLUME)

    def _add_to_remainder(self, parcel: _Parcel) -> None:
        """Let what a parcel has left gather with that of others."""
        rest = self._remainder
        rest.volume += parcel.volume
        rest.water += parcel.water
        rest.size, rest.soil, rest.place = parcel.size, parcel.soil, parcel.place

    def _release_remainder(self, batch: _Batch, particles: SoilEngine, room: int) -> None:
        """Take particles out of what was left behind; none leaves less than the smallest over."""
        rest, smallest = self._remainder, _MIN_VOLUME_FRACTION * self._nominal_mm3
        while rest.volume >= smallest and len(batch.volumes) < room:
            volume = self._next_volume(batch, rest, particles)
            if rest.volume < volume + smallest:
                volume = min(rest.volume, MAX_ROW_VOLUME)
            self._append_particle(batch, rest, volume, rest.withdraw(volume))

    def _restore(self, batch: _Batch) -> None:
        """Count particles that could not be made as left behind, with the water they had."""
        self._remainder.volume += sum(batch.volumes)
        pairs = zip(batch.volumes, batch.moistures, strict=True)
        self._remainder.water += sum(volume * moisture for volume, moisture in pairs)

    def _append_particle(self, batch: _Batch, parcel: _Parcel, volume: int, water: int) -> None:
        """Note a particle of the soil and at the place of a parcel."""
        moisture, over = divmod(water, volume)
        if over:
            moisture += 2 * (self._rounding_error + over) > volume
        self._rounding_error += water - moisture * volume
        batch.volumes.append(volume)
        batch.places.append(parcel.place)
        batch.soils.append(parcel.soil)
        batch.moistures.append(moisture)

    def _draw_volume(self, spread: float) -> int:
        """Volume of a particle [mm^3], even between nominal * (1 - spread) and (1 + spread)."""
        if spread == 0.0:
            return self._nominal_mm3
        return round(self._nominal_mm3 * (1.0 + spread * self._rng.uniform(-1.0, 1.0)))

    def _insert_particles(
        self,
        particles: SoilEngine,
        pose: Pose,
        batch: _Batch,
        release_twist: tuple[Vector, Vector] | None,
    ) -> None:
        rotation, origin = pose
        volume = np.array(batch.volumes, dtype=np.int64)
        # Particles of one place scatter over the room their soil takes.
        spread = 0.5 * np.cbrt(volume * 1e-9)[:, None]
        local = np.array(batch.places) + spread * self._rng.uniform(-1.0, 1.0, (volume.size, 3))
        local = self._shape.release_points(local, _CLEARANCE, rotation[2])
        arm = local @ rotation.T
        velocity = np.zeros_like(local)
        if release_twist is not None:
            velocity = release_twist[0] + np.cross(release_twist[1], arm)
        particles.add(
            arm + origin,
            velocity,
            volume,
            np.array(batch.soils, dtype=np.uint8),
            np.array(batch.moistures, dtype=np.uint8),
        )

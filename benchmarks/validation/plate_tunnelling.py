"""Detect particles that pass through plates from their positions alone.

The engine counts tunnelling by its own contacts, so a missed contact is missing in its count. This
count is independent: the path of a particle in one physics step is a straight line in the bucket
frame, and a plate is a polygon; a line that crosses a polygon is a particle that tunnelled. Steps
are short enough for straight lines: a particle that slides around the lip stays a radius away.

`TunnellingMonitor` watches the bucket of a machine, `sweep_plate` a plate that strikes small
particles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.validation.experiment_setup import STEP, make_engine
from machine_sim.dem import ParticleEngine
from machine_sim.dem.sleep import FIRST_LOCKED_TOOL
from machine_sim.simulation import MachineSim
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["PlateSet", "TunnellingMonitor", "sweep_plate"]

Array = NDArray[np.float64]

_NUM_STRUCK = 200
"""Number of particles that a plate strikes."""
_CLOUD = np.array([0.3, 1.6, 1.6])
"""Size of the cloud of particles before the plate [m]; its middle is 3 m above the ground."""
_RUN_UP, _SWEEP_LENGTH = 0.2, 1.0
"""Distance of the plate from the cloud, and length of its sweep [m]."""


class PlateSet:
    """Thin convex plates in one frame."""

    def __init__(self, plates: Sequence[Array]) -> None:
        """
        Args:
            plates: corners of each plate [m], shape (k, 3), in order around the plate.
        """
        corners = np.concatenate(plates)
        self._centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        self._reach = float(np.linalg.norm(corners - self._centre, axis=1).max())
        normals = np.array([np.cross(p[1] - p[0], p[2] - p[0]) for p in plates])
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self._offsets = np.array([n @ p[0] for n, p in zip(self._normals, plates, strict=True)])
        # Corners are counter-clockwise about these normals, so a plate is left of its edges.
        self._inward = [
            np.cross(n, np.roll(p, -1, axis=0) - p)
            for n, p in zip(self._normals, plates, strict=True)
        ]
        self._edges = [(i * p).sum(axis=1) for i, p in zip(self._inward, plates, strict=True)]

    def find_crossings(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Return a mask of the straight paths that cross a plate, shape (n,).

        Args:
            before, after: ends of the paths [m], shape (n, 3).
        """
        crosses = np.zeros(len(before), dtype=np.bool_)
        length = np.linalg.norm(after - before, axis=1)
        near = np.linalg.norm(after - self._centre, axis=1) <= self._reach + length
        start = before @ self._normals.T - self._offsets
        end = after @ self._normals.T - self._offsets
        changes = ((start >= 0.0) != (end >= 0.0)) & near[:, None]
        for k in np.flatnonzero(changes.any(axis=0)):
            rows = np.flatnonzero(changes[:, k])
            fraction = start[rows, k] / (start[rows, k] - end[rows, k])
            point = before[rows] + fraction[:, None] * (after[rows] - before[rows])
            crosses[rows] |= (point @ self._inward[k].T >= self._edges[k]).all(axis=1)
        return crosses


def sweep_plate(radius: float, speed: float, seed: int = 0) -> int:
    """Sweep a plate of 4 m^2 through particles at rest; return how often one passed through it.

    Without gravity every particle stays in the plate's way, and is struck by others as well.

    Args:
        radius: radius of the particles [m].
        speed: speed of the plate, along its normal [m/s].
        seed: seed of the places of the particles.
    """
    soil = LooseSoil()
    litre = make_engine(soil, gravity=0.0)
    litre.add([[0.0, 0.0, 3.0]], np.zeros((1, 3)), 1_000_000, grow=False)
    volume = round(1e6 * (radius / float(litre.state.radius[0])) ** 3)
    engine = make_engine(soil, gravity=0.0, nominal_volume=volume)
    corners = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
    plates, rotation = PlateSet([corners]), np.eye(3)
    origin = np.array([-_RUN_UP, 0.0, 3.0])
    engine.add_tool(0, [corners], (rotation, origin))
    rng = np.random.default_rng(seed)
    places = rng.uniform([0.0, -0.5, -0.5], [1.0, 0.5, 0.5], (_NUM_STRUCK, 3)) * _CLOUD
    engine.add(places + origin * [0.0, 0.0, 1.0], np.zeros_like(places), volume, grow=False)
    num_crossings, advance = 0, np.array([speed * STEP, 0.0, 0.0])
    for _ in range(round(_SWEEP_LENGTH / (speed * STEP))):
        ids = engine.ids
        before = engine.positions - origin
        engine.set_tool_motion(0, (rotation, origin), (rotation, origin + advance))
        engine.step(STEP)
        origin = origin + advance
        after = engine.positions[engine.rows_of(ids)] - origin
        num_crossings += int(plates.find_crossings(before, after).sum())
    return num_crossings


class TunnellingMonitor:
    """Monitor of the particles in a machine's bucket in every physics step.

    Attributes:
        num_crossings: number of plate crossings so far.
        max_in_bucket: maximum number of particles in the bucket.
        max_locked_particles: maximum number of particles in the locked load.
        max_particle_speed: maximum speed of a particle in the bucket, relative to it [m/s].
    """

    def __init__(self, machine: MachineSim) -> None:
        """Start monitoring; replaces the engine's step, because a tick has several steps."""
        self.num_crossings = self.max_in_bucket = self.max_locked_particles = 0
        self.max_particle_speed = 0.0
        assert isinstance(machine.particles, ParticleEngine)
        self._machine, self._engine = machine.machine, machine.particles
        self._bucket = self._machine.spec.bucket
        self._plates = PlateSet(self._bucket.plates())
        self._pose = self._machine.tool.pose
        self._step = self._engine.step
        self._engine.step = self.step  # type: ignore[method-assign]

    def step(self, dt: float) -> None:
        """Advance the engine one step and count crossings."""
        engine = self._engine
        # Frozen particles belong to the terrain, which a tool may cut through.
        ids = np.setdiff1d(engine.ids, engine.frozen_ids)
        before = self._local(ids)
        self._step(dt)
        self._pose = self._machine.tool.pose
        after = self._local(ids)
        self.num_crossings += int(self._plates.find_crossings(before, after).sum())
        inside = self._bucket.contains(after)
        self.max_in_bucket = max(self.max_in_bucket, int(inside.sum()))
        self.max_locked_particles = max(
            self.max_locked_particles, int((engine.sleep_states >= FIRST_LOCKED_TOOL).sum())
        )
        speed = np.linalg.norm(after - before, axis=1)[inside] / dt
        self.max_particle_speed = max(self.max_particle_speed, float(speed.max(initial=0.0)))

    def _local(self, ids: NDArray[np.uint32]) -> Array:
        """Return particle positions [m], bucket frame, shape (n, 3)."""
        rotation, origin = self._pose
        positions = self._engine.positions[self._engine.rows_of(ids)]
        return np.asarray((positions - origin) @ rotation)

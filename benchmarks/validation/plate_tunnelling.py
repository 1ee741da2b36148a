"""Who went through the plates of a bucket: told from positions alone, apart from the engine.

The engine counts by its own contacts, and what blinds them blinds its count. Here a particle's way
in one physics step is a straight line in the bucket's frame, and a plate is a polygon: a line that
pierces a polygon is a particle that went through. Steps are short enough for that: what slips round
the lip turns about it at a radius' distance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.sleep import FIRST_LOCKED_TOOL
from machine_sim.simulation import MachineSim

__all__ = ["PlateSet", "TunnellingMonitor"]

Array = NDArray[np.float64]


class PlateSet:
    """Thin convex plates."""

    def __init__(self, plates: Sequence[Array]) -> None:
        """
        Args:
            plates: corners (k, 3) of each [m], in order around.
        """
        corners = np.concatenate(plates)
        self._centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        self._reach = float(np.linalg.norm(corners - self._centre, axis=1).max())
        crosses = np.array([np.cross(p[1] - p[0], p[2] - p[0]) for p in plates])
        self._normals = crosses / np.linalg.norm(crosses, axis=1, keepdims=True)
        self._offsets = np.array([n @ p[0] for n, p in zip(self._normals, plates, strict=True)])
        # Corners go counter-clockwise about these normals, so a plate lies left of its edges.
        self._inward = [
            np.cross(n, np.roll(p, -1, axis=0) - p)
            for n, p in zip(self._normals, plates, strict=True)
        ]
        self._edges = [(i * p).sum(axis=1) for i, p in zip(self._inward, plates, strict=True)]

    def count_tunnelled(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Which straight ways go through a plate.

        Args:
            before, after: ends of the ways [m], shape (n, 3).
        """
        through = np.zeros(len(before), dtype=np.bool_)
        length = np.linalg.norm(after - before, axis=1)
        near = np.linalg.norm(after - self._centre, axis=1) <= self._reach + length
        start = before @ self._normals.T - self._offsets
        end = after @ self._normals.T - self._offsets
        changes = ((start >= 0.0) != (end >= 0.0)) & near[:, None]
        for k in np.flatnonzero(changes.any(axis=0)):
            rows = np.flatnonzero(changes[:, k])
            share = start[rows, k] / (start[rows, k] - end[rows, k])
            at = before[rows] + share[:, None] * (after[rows] - before[rows])
            through[rows] |= (at @ self._inward[k].T >= self._edges[k]).all(axis=1)
        return through


class TunnellingMonitor:
    """Looks at a machine's particles in every physics step.

    Attributes:
        pierced: how often one went through a plate so far.
        held: most that were in the bucket at once.
        riding: most of them that rode in it as one body.
        fastest: of those in the bucket, seen from it [m/s].
    """

    def __init__(self, machine: MachineSim) -> None:
        """Watch from now on: the engine's step is wrapped, since a tick has more than one."""
        self.count_tunnelled = self.max_in_bucket = self.max_locked_particles = 0
        self.max_particle_speed = 0.0
        self._machine, self._engine = machine.machine, machine.particles
        self._bucket = self._machine.spec.bucket
        self._shell = PlateSet(self._bucket.plates())
        self._pose = self._machine.tool.pose
        self._step = self._engine.step
        self._engine.step = self.step  # type: ignore[method-assign]

    def step(self, dt: float) -> None:
        """A step of the engine."""
        engine = self._engine
        # Soil that has landed is the terrain's, which a tool may cut through.
        ids = np.setdiff1d(engine.ids, engine.frozen_ids)
        before = self._local(ids)
        self._step(dt)
        self._pose = self._machine.tool.pose
        after = self._local(ids)
        self.count_tunnelled += int(self._shell.count_tunnelled(before, after).sum())
        inside = self._bucket.contains(after)
        self.max_in_bucket = max(self.max_in_bucket, int(inside.sum()))
        self.max_locked_particles = max(
            self.max_locked_particles, int((engine.sleep_states >= FIRST_LOCKED_TOOL).sum())
        )
        speed = np.linalg.norm(after - before, axis=1)[inside] / dt
        self.max_particle_speed = max(self.max_particle_speed, float(speed.max(initial=0.0)))

    def _local(self, ids: NDArray[np.uint32]) -> Array:
        """Where particles are, bucket frame [m], shape (n, 3)."""
        rotation, origin = self._pose
        at = self._engine.positions[self._engine.rows_of(ids)]
        return np.asarray((at - origin) @ rotation)

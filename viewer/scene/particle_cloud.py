"""Particles in the layout that the page draws: 16 bytes each, positions relative to their box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msg_bridge.contract.rows import Rows

__all__ = ["DISPLAY_PARTICLE", "ParticleBlock", "encode_particles"]

DISPLAY_PARTICLE = np.dtype(
    [
        ("position", "<u2", (3,)),  # origin + scale * value is the centre [m]
        ("id", "<u2"),  # low bits of the particle's number
        ("velocity", "<i2", (3,)),  # [mm/s]
        ("diameter", "u1"),  # [5 mm]
        ("soil", "u1"),  # id of the soil type
    ]
)
"""A particle as it is sent."""

_MAX_POSITION = 2**16 - 1
_MAX_SPEED = 2**15 - 1  # mm/s
_DIAMETER_UNIT = 0.005  # m
_ID_STEP = 21_845
"""Difference between the ids of particles of equal number of two machine nodes: 2**16 / 3."""


@dataclass(frozen=True)
class ParticleBlock:
    """Particles of all machine nodes.

    Attributes:
        count: their number.
        origin: smallest x, y, z [m], map frame.
        scale: size of one step of each coordinate [m].
        data: `count` particles of `DISPLAY_PARTICLE`.
    """

    count: int
    origin: tuple[float, float, float]
    scale: tuple[float, float, float]
    data: bytes


def encode_particles(clouds: Sequence[Rows]) -> ParticleBlock:
    """Return the particles of some machine nodes, PARTICLE rows, as one block.

    Particles whose position or velocity is not finite are left out.
    """
    parts = [_finite(cloud) for cloud in clouds]
    count = sum(part.size for part in parts)
    if count == 0:
        return ParticleBlock(0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), b"")
    positions = np.empty((count, 3))
    out = np.empty(count, dtype=DISPLAY_PARTICLE)
    begin = 0
    for index, part in enumerate(parts):
        rows = slice(begin, begin + part.size)
        for axis, name in enumerate("xyz"):
            positions[rows, axis] = part[name]
            speed = np.rint(part[f"v{name}"].astype(np.float64) * 1e3)
            out["velocity"][rows, axis] = np.clip(speed, -_MAX_SPEED, _MAX_SPEED)
        out["id"][rows] = (part["id"] + np.uint32(index * _ID_STEP)) & 0xFFFF
        steps = np.rint(np.nan_to_num(part["diameter"], posinf=0.0) / _DIAMETER_UNIT)
        out["diameter"][rows] = np.clip(steps, 1, 255)
        out["soil"][rows] = part["soil"]
        begin += part.size
    low, high = positions.min(axis=0), positions.max(axis=0)
    scale = np.maximum((high - low) / _MAX_POSITION, 1e-6)
    out["position"] = np.rint((positions - low) / scale)
    return ParticleBlock(
        count, (low[0], low[1], low[2]), (scale[0], scale[1], scale[2]), out.tobytes()
    )


def _finite(cloud: Rows) -> Rows:
    fields = ("x", "y", "z", "vx", "vy", "vz")
    is_finite = np.isfinite(sum(cloud[name].astype(np.float64) for name in fields))
    return cloud if np.all(is_finite) else cloud[is_finite]

"""A bucket of soil carried: lifted, swung, stopped hard, and tipped out slowly.

The bucket is the excavator's of `config/machines/excavator.yaml`, 1.2 m wide, its mouth level.

There is no law for this, but there is what gravity does. Soil that lies flatter than its angle of
repose, as seen with the acceleration, stays. When a bucket stops at once, what is heaped above its
sides goes on for v^2 / (2 g tan(angle of repose)), 0.35 m at 2 m/s and 30 degrees, and a part of
the heap falls off; what lies below the mouth cannot. Tipped, soil pours from when the slope from
rim to lip is steeper than its angle of repose, until the steel under it is steeper than its
friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.laboratory.scenes import STEP, Plate, bench, stack
from machine_sim.machine import load_description
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.particles import ParticleEngine, Pose
from machine_sim.particles.sleep import ON_MAP
from msg_bridge.config_files import find_config
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["Carry", "carry"]

_FILL = 0.9
"""Loose soil put in, over the bucket's struck volume."""
_HEIGHT = 1.0
"""Of the mouth over the bench as it is filled [m]."""
_REACH = 6.0
"""Of the bucket from the axis about which it swings [m]."""
_ACCELERATION = 3.0
"""Of lift and swing [m/s^2]."""
_LIFT_SPEED, _SWING_SPEED = 1.5, 2.0
"""[m/s]"""
_CRUISE = 0.5
"""Time at full speed [s]."""
_STOP = 0.1
"""Time of the hard stop [s]."""
_PAUSE = 1.0
"""After each motion [s]."""
_TIPPED = 130.0
"""Tilt at the end [deg]."""
_TIP_SPEED = 10.0
"""[deg/s]"""
_BUCKET = 0


@dataclass(frozen=True)
class Carry:
    """What became of the soil in a bucket.

    Attributes:
        particles: how many lay in the bucket before it moved.
        fill: their loose volume over the bucket's struck volume.
        swung: part of them that was left after lift and swing.
        retained: part that was left after the hard stop too.
        begins, half, most: tilt at which 2, 50 and 90 % of these were out [deg].
        between: part of these that went out between 45 and 90 deg.
        left: part of these that was in the bucket at the end.
        tunnelled: how many went through a plate.
        rode: part of the particles that rode in the bucket as one body, at most.
    """

    particles: int
    fill: float
    swung: float
    retained: float
    begins: float
    half: float
    most: float
    between: float
    left: float
    tunnelled: int
    rode: float


def carry(
    soil: LooseSoil,
    count: int,
    *,
    fill: float = _FILL,
    tip_speed: float = _TIP_SPEED,
    **params: float,
) -> Carry:
    """Fill a bucket, carry it and tip it out.

    Args:
        soil: its soil.
        count: particles put in; their size follows.
        fill: their loose volume over the bucket's struck volume; what finds no room is taken away.
        tip_speed: [deg/s].
        params: of `ParticleParams`.
    """
    bucket = load_description(find_config("machines/excavator.yaml")).bucket
    engine = bench(soil, **params)
    volume = round(fill * bucket.struck_capacity / (1.0 + soil.swell) / count * 1e9)
    scene = _Scene(engine, bucket)
    scene.fill(count, volume)
    before = scene.keep()
    scene.go(_lift(scene.pose))
    scene.go(_swing(scene.pose, _SWING_SPEED / _ACCELERATION))
    swung = scene.held()
    scene.go(_swing(scene.pose, _STOP))
    stopped = scene.keep()
    steps = round(_TIPPED / tip_speed / STEP)
    tilt = _TIPPED * np.arange(1, steps + 1) / steps
    inside = np.array([scene.held() for _ in scene.move(_tip(scene.pose, tilt))]) / stopped
    scene.go([scene.pose] * round(_PAUSE / STEP))
    begins, half, most = (
        float(tilt[np.argmax(inside <= 1.0 - out)]) if inside[-1] <= 1.0 - out else math.nan
        for out in (0.02, 0.5, 0.9)
    )
    return Carry(
        before,
        before / count * fill,
        swung / before,
        stopped / before,
        begins,
        half,
        most,
        float(-np.diff(np.interp([45.0, 90.0], tilt, inside))[0]),
        scene.held() / stopped,
        engine.tunnelled_tool,
        scene.riding / before,
    )


class _Scene:
    """A bucket and the soil in it.

    The bucket's frame has its origin in the middle of the lip, x out over the lip, and z out of the
    mouth.

    Attributes:
        pose: where the bucket is.
        riding: most particles that rode in it as one body at once.
    """

    def __init__(self, engine: ParticleEngine, bucket: BucketShape) -> None:
        self._engine = engine
        self._shape = bucket
        lip, rim = bucket.profile[0], bucket.profile[-1]
        along, up = (lip - rim) / bucket.mouth_length, bucket.mouth_normal[[0, 2]]
        self._profile = (bucket.profile - lip) @ np.stack([along, up], axis=1)
        self.pose: Pose = (np.eye(3), np.array([_REACH, 0.0, _HEIGHT]))
        self.riding = 0
        engine.add_tool(_BUCKET, self._plates(), self.pose)

    def _plates(self) -> list[Plate]:
        left, right = (
            [(float(x), 0.5 * side * self._shape.width, float(z)) for x, z in self._profile]
            for side in (1, -1)
        )
        strips = [
            [left[k], left[k + 1], right[k + 1], right[k]] for k in range(len(self._profile) - 1)
        ]
        return [*strips, left[::-1], right]

    def fill(self, count: int, volume: int) -> None:
        """Let particles of a bank volume [mm^3] fall in through the mouth, and settle."""
        engine, length, width = self._engine, self._shape.mouth_length, self._shape.width
        trial = ParticleEngine(engine.params, engine.ground, soils=engine.soils)
        trial.add([[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], volume)
        d = 2.0 * float(trial.store.radius[0])
        points = stack(
            lambda at: (np.abs(at[:, 0]) < 0.5 * length - d) & (np.abs(at[:, 1]) < 0.5 * width - d),
            0.5 * max(length, width),
            1.3 * d,
            count,
            d,
        )
        points += self.pose[1] - [0.5 * length, 0.0, 0.0]
        engine.add(points, np.zeros_like(points), volume, grow=False)
        self.go([self.pose] * round(4.0 / STEP))

    def go(self, way: Iterable[Pose]) -> None:
        """Move the bucket along some poses, one a step."""
        for _ in self.move(way):
            pass

    def move(self, way: Iterable[Pose]) -> Iterator[None]:
        """The same, with a pause after each step."""
        for pose in way:
            self._engine.set_tool(_BUCKET, self.pose, pose)
            self.pose = pose
            self._engine.step(STEP)
            self.riding = max(self.riding, int((self._engine.store.resting > ON_MAP).sum()))
            yield

    def _inside(self) -> NDArray[np.bool_]:
        """Who is in the bucket or in the heap on it."""
        x, y, z = self._engine.tool_local(_BUCKET).T
        depth, length = -self._profile[:, 1].min(), self._shape.mouth_length
        wide = np.abs(y) <= 0.5 * self._shape.width
        return np.asarray(wide & (x > -length) & (x < 0.0) & (z > -depth) & (z < 0.5 * length))

    def held(self) -> int:
        """How many are in the bucket or in the heap on it."""
        return int(self._inside().sum())

    def keep(self) -> int:
        """Take away all that is not in it; returns how many are."""
        self._engine.remove(self._engine.store.particle_id[~self._inside()])
        return self._engine.count


def _speeds(top: float, brake: float) -> NDArray[np.float64]:
    """Speed in each step of a motion [m/s] up to `top` [m/s], braked in `brake` [s]."""
    start = top / _ACCELERATION
    end = start + _CRUISE + brake
    middle = STEP * (np.arange(round(end / STEP)) + 0.5)
    ramp = np.minimum(middle / start, (end - middle) / brake)
    return np.concatenate([top * np.clip(ramp, 0.0, 1.0), np.zeros(round(_PAUSE / STEP))])


def _lift(pose: Pose) -> list[Pose]:
    ways = STEP * np.cumsum(_speeds(_LIFT_SPEED, _LIFT_SPEED / _ACCELERATION))
    return [(pose[0], pose[1] + [0.0, 0.0, way]) for way in ways]


def _swing(pose: Pose, brake: float) -> list[Pose]:
    """About the upright axis through the origin, braked in `brake` [s]."""
    turns = (_about_z(way / _REACH) for way in STEP * np.cumsum(_speeds(_SWING_SPEED, brake)))
    return [(turn @ pose[0], turn @ pose[1]) for turn in turns]


def _tip(pose: Pose, tilt: NDArray[np.float64]) -> list[Pose]:
    """About the lip, by some angles [deg]."""
    return [(pose[0] @ _about_y(math.radians(angle)), pose[1]) for angle in tilt]


def _about_y(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _about_z(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

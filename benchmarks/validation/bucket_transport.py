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

from benchmarks.validation.experiment_setup import STEP, Plate, layered_points, make_engine
from machine_sim.dem import ParticleEngine, Pose
from machine_sim.dem.sleep import FIRST_LOCKED_TOOL
from machine_sim.machine import load_machine_spec
from machine_sim.machine.tools.bucket import BucketShape
from msg_bridge.config_files import find_config
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["TransportResult", "transport_soil"]

_FILL = 0.9
"""Loose soil put in, over the bucket's struck volume."""
_MOUTH_HEIGHT = 1.0
"""Of the mouth over the bench as it is filled [m]."""
_SWING_RADIUS = 6.0
"""Of the bucket from the axis about which it swings [m]."""
_ACCELERATION = 3.0
"""Of lift and swing [m/s^2]."""
_LIFT_SPEED, _SWING_SPEED = 1.5, 2.0
"""[m/s]"""
_CRUISE_TIME = 0.5
"""Time at full speed [s]."""
_STOP_TIME = 0.1
"""Time of the hard stop [s]."""
_PAUSE_TIME = 1.0
"""After each motion [s]."""
_FINAL_TILT = 130.0
"""Tilt at the end [deg]."""
_TIP_SPEED = 10.0
"""[deg/s]"""
_BUCKET = 0


@dataclass(frozen=True)
class TransportResult:
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
    fraction_after_swing: float
    fraction_after_stop: float
    begins: float
    half: float
    most: float
    between: float
    left: float
    tunnelled: int
    max_locked_fraction: float


def transport_soil(
    soil: LooseSoil,
    count: int,
    *,
    fill: float = _FILL,
    tip_speed: float = _TIP_SPEED,
    **params: float,
) -> TransportResult:
    """Fill a bucket, carry it and tip it out.

    Args:
        soil: its soil.
        count: particles put in; their size follows.
        fill: their loose volume over the bucket's struck volume; what finds no room is taken away.
        tip_speed: [deg/s].
        params: of `ParticleParams`.
    """
    bucket = load_machine_spec(find_config("machines/excavator.yaml")).bucket
    engine = make_engine(soil, **params)
    volume = round(fill * bucket.struck_capacity / (1.0 + soil.swell) / count * 1e9)
    scene = _Scene(engine, bucket)
    scene.fill(count, volume)
    before = scene.remove_outside()
    scene.follow_poses(_lift(scene.pose))
    scene.follow_poses(_swing(scene.pose, _SWING_SPEED / _ACCELERATION))
    fraction_after_swing = scene.count_inside()
    scene.follow_poses(_swing(scene.pose, _STOP_TIME))
    stopped = scene.remove_outside()
    steps = round(_FINAL_TILT / tip_speed / STEP)
    tilt = _FINAL_TILT * np.arange(1, steps + 1) / steps
    inside = np.array([scene.count_inside() for _ in scene.move(_tip(scene.pose, tilt))]) / stopped
    scene.follow_poses([scene.pose] * round(_PAUSE_TIME / STEP))
    begins, half, most = (
        float(tilt[np.argmax(inside <= 1.0 - out)]) if inside[-1] <= 1.0 - out else math.nan
        for out in (0.02, 0.5, 0.9)
    )
    return TransportResult(
        before,
        before / count * fill,
        fraction_after_swing / before,
        stopped / before,
        begins,
        half,
        most,
        float(-np.diff(np.interp([45.0, 90.0], tilt, inside))[0]),
        scene.count_inside() / stopped,
        engine.num_plate_tunnellings,
        scene.max_locked_particles / before,
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
        along, up = (lip - rim) / bucket.opening_length, bucket.opening_normal[[0, 2]]
        self._profile = (bucket.profile - lip) @ np.stack([along, up], axis=1)
        self.pose: Pose = (np.eye(3), np.array([_SWING_RADIUS, 0.0, _MOUTH_HEIGHT]))
        self.max_locked_particles = 0
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
        engine, length, width = self._engine, self._shape.opening_length, self._shape.width
        trial = ParticleEngine(engine.params, engine.ground, soils=engine.soils)
        trial.add([[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], volume)
        d = 2.0 * float(trial.radii[0])
        points = layered_points(
            lambda at: (np.abs(at[:, 0]) < 0.5 * length - d) & (np.abs(at[:, 1]) < 0.5 * width - d),
            0.5 * max(length, width),
            1.3 * d,
            count,
            d,
        )
        points += self.pose[1] - [0.5 * length, 0.0, 0.0]
        engine.add(points, np.zeros_like(points), volume, grow=False)
        self.follow_poses([self.pose] * round(4.0 / STEP))

    def follow_poses(self, way: Iterable[Pose]) -> None:
        """Move the bucket along some poses, one a step."""
        for _ in self.move(way):
            pass

    def move(self, way: Iterable[Pose]) -> Iterator[None]:
        """The same, with a pause after each step."""
        for pose in way:
            self._engine.set_tool_motion(_BUCKET, self.pose, pose)
            self.pose = pose
            self._engine.step(STEP)
            self.max_locked_particles = max(
                self.max_locked_particles,
                int((self._engine.sleep_states >= FIRST_LOCKED_TOOL).sum()),
            )
            yield

    def _inside(self) -> NDArray[np.bool_]:
        """Return a mask of the particles in the bucket or in the heap on it."""
        x, y, z = self._engine.positions_in_tool_frame(_BUCKET).T
        depth, length = -self._profile[:, 1].min(), self._shape.opening_length
        wide = np.abs(y) <= 0.5 * self._shape.width
        return np.asarray(wide & (x > -length) & (x < 0.0) & (z > -depth) & (z < 0.5 * length))

    def count_inside(self) -> int:
        """Return the number of particles in the bucket or in the heap on it."""
        return int(self._inside().sum())

    def remove_outside(self) -> int:
        """Remove all particles outside of it and return the number of those left."""
        self._engine.remove(self._engine.ids[~self._inside()])
        return self._engine.count


def _speeds(top: float, brake: float) -> NDArray[np.float64]:
    """Speed in each step of a motion [m/s] up to `top` [m/s], braked in `brake` [s]."""
    start = top / _ACCELERATION
    end = start + _CRUISE_TIME + brake
    middle = STEP * (np.arange(round(end / STEP)) + 0.5)
    ramp = np.minimum(middle / start, (end - middle) / brake)
    return np.concatenate([top * np.clip(ramp, 0.0, 1.0), np.zeros(round(_PAUSE_TIME / STEP))])


def _lift(pose: Pose) -> list[Pose]:
    ways = STEP * np.cumsum(_speeds(_LIFT_SPEED, _LIFT_SPEED / _ACCELERATION))
    return [(pose[0], pose[1] + [0.0, 0.0, way]) for way in ways]


def _swing(pose: Pose, brake: float) -> list[Pose]:
    """About the upright axis through the origin, braked in `brake` [s]."""
    turns = (
        _about_z(way / _SWING_RADIUS) for way in STEP * np.cumsum(_speeds(_SWING_SPEED, brake))
    )
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

"""Transport soil in a bucket: lift, swing, stop hard, and tip slowly.

The bucket is that of `config/machines/excavator.yaml`, 1.2 m wide, with its opening level.

No published law applies, but statics give bounds. Soil whose surface is flatter than its angle of
repose, relative to the effective gravity, stays. When a bucket stops abruptly, soil heaped above
its sides slides on by v^2 / (2 g tan(angle of repose)), 0.35 m at 2 m/s and 30 degrees, and a part
of the heap falls off; soil below the opening cannot. While the bucket is tipped, soil flows out
from when the slope from rim to lip exceeds its angle of repose until the steel under it exceeds
its friction angle.
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
"""Loose volume put in, over the struck capacity of the bucket."""
_OPENING_HEIGHT = 1.0
"""Height of the opening over the ground during filling [m]."""
_SWING_RADIUS = 6.0
"""Distance of the bucket from the swing axis [m]."""
_ACCELERATION = 3.0
"""Acceleration of lift and swing [m/s^2]."""
_LIFT_SPEED, _SWING_SPEED = 1.5, 2.0
"""Maximum speeds of lift and swing [m/s]."""
_CRUISE_TIME = 0.5
"""Time at full speed [s]."""
_STOP_TIME = 0.1
"""Duration of the hard stop [s]."""
_PAUSE_TIME = 1.0
"""Duration of the pause after each motion [s]."""
_FINAL_TILT = 130.0
"""Final tilt [deg]."""
_TIP_SPEED = 10.0
"""Angular speed of tipping [deg/s]."""
_BUCKET = 0
"""Tool number of the bucket."""


@dataclass(frozen=True)
class TransportResult:
    """Fractions of the soil in a bucket after each motion.

    Attributes:
        num_particles: number of particles in the bucket before it moved.
        fill: their loose volume over the struck capacity.
        fraction_after_swing: fraction in the bucket after lift and swing.
        fraction_after_stop: fraction in the bucket after the hard stop.
        tilt_at_2_percent, tilt_at_half, tilt_at_90_percent: tilt at which this part of the soil
            that was tipped had left the bucket [deg]; nan if it never did.
        fraction_out_45_to_90: fraction of the tipped soil that left between 45 and 90 deg.
        final_fraction: fraction of the tipped soil in the bucket at the end.
        num_tunnelled: number of particles that passed through a plate.
        max_locked_fraction: maximum fraction of the particles in the locked load.
    """

    num_particles: int
    fill: float
    fraction_after_swing: float
    fraction_after_stop: float
    tilt_at_2_percent: float
    tilt_at_half: float
    tilt_at_90_percent: float
    fraction_out_45_to_90: float
    final_fraction: float
    num_tunnelled: int
    max_locked_fraction: float


def transport_soil(
    soil: LooseSoil,
    count: int,
    *,
    fill: float = _FILL,
    tip_speed: float = _TIP_SPEED,
    **params: float,
) -> TransportResult:
    """Fill a bucket, transport it and tip it.

    Args:
        soil: the soil.
        count: number of particles put in; their size follows from `fill`.
        fill: loose volume put in, over the struck capacity; particles that fall beside the bucket
            are removed.
        tip_speed: angular speed of tipping [deg/s].
        params: further parameters of `ParticleParams`.
    """
    bucket = load_machine_spec(find_config("machines/excavator.yaml")).bucket
    engine = make_engine(soil, **params)
    volume = round(fill * bucket.struck_capacity / (1.0 + soil.swell) / count * 1e9)
    scene = _Scene(engine, bucket, soil.moisture)
    scene.fill(count, volume)
    num_before = scene.remove_outside()
    scene.follow_poses(_lift(scene.pose))
    scene.follow_poses(_swing(scene.pose, _SWING_SPEED / _ACCELERATION))
    num_after_swing = scene.count_inside()
    scene.follow_poses(_swing(scene.pose, _STOP_TIME))
    num_tipped = scene.remove_outside()
    steps = round(_FINAL_TILT / tip_speed / STEP)
    tilt = _FINAL_TILT * np.arange(1, steps + 1) / steps
    num_inside = [scene.count_inside() for _ in scene.move(_tip(scene.pose, tilt))]
    inside = np.array(num_inside) / num_tipped
    scene.follow_poses([scene.pose] * round(_PAUSE_TIME / STEP))
    tilts = [
        float(tilt[np.argmax(inside <= 1.0 - out)]) if inside[-1] <= 1.0 - out else math.nan
        for out in (0.02, 0.5, 0.9)
    ]
    return TransportResult(
        num_particles=num_before,
        fill=num_before / count * fill,
        fraction_after_swing=num_after_swing / num_before,
        fraction_after_stop=num_tipped / num_before,
        tilt_at_2_percent=tilts[0],
        tilt_at_half=tilts[1],
        tilt_at_90_percent=tilts[2],
        fraction_out_45_to_90=float(-np.diff(np.interp([45.0, 90.0], tilt, inside))[0]),
        final_fraction=scene.count_inside() / num_tipped,
        num_tunnelled=engine.num_plate_tunnellings,
        max_locked_fraction=scene.max_locked_particles / num_before,
    )


class _Scene:
    """A bucket and the soil in it.

    The bucket frame has its origin in the middle of the lip, x forward over the lip, and z out of
    the opening.

    Attributes:
        pose: pose of the bucket, ground frame.
        max_locked_particles: maximum number of particles in the locked load.
    """

    def __init__(self, engine: ParticleEngine, bucket: BucketShape, moisture: int) -> None:
        self._engine, self._moisture = engine, moisture
        self._shape = bucket
        lip, rim = bucket.profile[0], bucket.profile[-1]
        along, up = (lip - rim) / bucket.opening_length, bucket.opening_normal[[0, 2]]
        self._profile = (bucket.profile - lip) @ np.stack([along, up], axis=1)
        self.pose: Pose = (np.eye(3), np.array([_SWING_RADIUS, 0.0, _OPENING_HEIGHT]))
        self.max_locked_particles = 0
        engine.add_tool(_BUCKET, self._plates(), self.pose)

    def _plates(self) -> list[Plate]:
        """Return the plates of the shell and of the two sides, bucket frame."""
        left, right = (
            [(float(x), 0.5 * side * self._shape.width, float(z)) for x, z in self._profile]
            for side in (1, -1)
        )
        strips = [
            [left[k], left[k + 1], right[k + 1], right[k]] for k in range(len(self._profile) - 1)
        ]
        return [*strips, left[::-1], right]

    def fill(self, count: int, volume: int) -> None:
        """Drop particles of a bank volume [mm^3] through the opening and let them settle."""
        engine, length, width = self._engine, self._shape.opening_length, self._shape.width
        trial = ParticleEngine(engine.params, engine.ground, soils=engine.soils)
        trial.add([[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], volume, moisture=self._moisture)
        d = 2.0 * float(trial.radii[0])
        points = layered_points(
            lambda xy: (np.abs(xy[:, 0]) < 0.5 * length - d) & (np.abs(xy[:, 1]) < 0.5 * width - d),
            0.5 * max(length, width),
            1.3 * d,
            count,
            d,
        )
        points += self.pose[1] - [0.5 * length, 0.0, 0.0]
        engine.add(points, np.zeros_like(points), volume, moisture=self._moisture, grow=False)
        self.follow_poses([self.pose] * round(4.0 / STEP))

    def follow_poses(self, poses: Iterable[Pose]) -> None:
        """Move the bucket through some poses, one for each step."""
        for _ in self.move(poses):
            pass

    def move(self, poses: Iterable[Pose]) -> Iterator[None]:
        """Move the bucket through some poses and yield after each step."""
        for pose in poses:
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
        is_between_sides = np.abs(y) <= 0.5 * self._shape.width
        return np.asarray(
            is_between_sides & (x > -length) & (x < 0.0) & (z > -depth) & (z < 0.5 * length)
        )

    def count_inside(self) -> int:
        """Return the number of particles in the bucket or in the heap on it."""
        return int(self._inside().sum())

    def remove_outside(self) -> int:
        """Remove all other particles and return the number of the remaining ones."""
        self._engine.remove(self._engine.ids[~self._inside()])
        return self._engine.count


def _displacements(max_speed: float, stop_time: float) -> NDArray[np.float64]:
    """Return the displacement [m] after each step of a motion, and during the pause after it.

    Args:
        max_speed: [m/s].
        stop_time: duration of the deceleration [s].
    """
    start_time = max_speed / _ACCELERATION
    end = start_time + _CRUISE_TIME + stop_time
    time = STEP * (np.arange(round(end / STEP)) + 0.5)
    ramp = np.minimum(time / start_time, (end - time) / stop_time)
    pause = np.zeros(round(_PAUSE_TIME / STEP))
    return STEP * np.cumsum(np.concatenate([max_speed * np.clip(ramp, 0.0, 1.0), pause]))


def _lift(pose: Pose) -> list[Pose]:
    """Return the poses of a vertical motion."""
    heights = _displacements(_LIFT_SPEED, _LIFT_SPEED / _ACCELERATION)
    return [(pose[0], pose[1] + [0.0, 0.0, height]) for height in heights]


def _swing(pose: Pose, stop_time: float) -> list[Pose]:
    """Return the poses of a rotation about the z axis that stops in `stop_time` [s]."""
    arc_lengths = _displacements(_SWING_SPEED, stop_time)
    rotations = (_about_z(length / _SWING_RADIUS) for length in arc_lengths)
    return [(rotation @ pose[0], rotation @ pose[1]) for rotation in rotations]


def _tip(pose: Pose, tilt: NDArray[np.float64]) -> list[Pose]:
    """Return the poses of a rotation about the lip by some angles [deg]."""
    return [(pose[0] @ _about_y(math.radians(angle)), pose[1]) for angle in tilt]


def _about_y(angle: float) -> NDArray[np.float64]:
    """Return the rotation matrix about y by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _about_z(angle: float) -> NDArray[np.float64]:
    """Return the rotation matrix about z by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

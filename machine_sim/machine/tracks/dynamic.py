"""Tracks of rigid shoes hinged to one another, which the rear sprocket drives by friction.

The shoes are bodies in pybullet (`chain`), sprockets and idlers joints of the machine's
multibody (`gear`). What the shoes feel of the ground, which is the machine's own copy of the
terrain, and of the track's frame is worked out before each step (`hinged_contact`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.dynamic_step import (
    TrackDimensions,
    UndercarriageSupport,
    dynamic_track_step,
)
from machine_sim.machine.tracks.kinematic_step import add_hull_contact
from machine_sim.machine.tracks.running_gear import (
    NUM_SPROCKET_FLATS,
    SIDES,
    SPROCKET_CORNER_ANGLE,
    initial_shoe_poses,
    urdf_with_running_gear,
    with_dynamic_tracks,
)
from machine_sim.machine.tracks.shoe_chain import ShoeChains
from machine_sim.machine.tracks.terramechanics import soil_patch_under
from machine_sim.machine.tracks.track_model import Array, hull_corners, track_slip
from machine_sim.physics_engine import pybullet

__all__ = ["DynamicTracks"]

_MAX_BELT_ACCELERATION = 2.0
"""Greatest of a belt [m/s^2]: whipped harder, its slack side buckles."""

_TENSION_FRACTION, _TENSION_TIME = 0.55, 1.0
"""A new chain is tightened with this part of the traction, for this long [s]."""

_IDLER_LOCK_POSITION, _IDLER_LOCK_FORCE_FACTOR = 0.02, 5.5
"""Then the idler is held this far out [m], with up to this many times the traction."""

_MAX_REFERENCE_LEAD = 0.02
"""Furthest a sprocket's reference goes from its angle [rad]: one that stalls is not wound up."""

_BRAKED_TORQUE_FRACTION = 0.015
"""Part of its torque that a sprocket keeps where the brake holds the chain: strained against the
brake, it would let go by and by and move the machine each time."""

_SPROCKET_GAIN = 0.2
"""Part of a sprocket's error that is made up for in one step."""

_MAX_PATH_DEVIATION = 0.8
"""A shoe this far off its path, in parts of the sprocket's radius, has come off. Into a hollow of
the ground the chain sags half of that."""

_MAX_STIFFNESS_FACTOR, _MAX_DAMPING_FACTOR = 0.27, 0.36
"""Bounds of a spring in parts of mass / step^2 and of a damper in parts of mass / step: with more,
a shoe, which is light beside what it carries, rings from step to step."""


class DynamicTracks:
    """The two tracks of a machine on the ground; attributes as in `Tracks`."""

    def __init__(self, spec: MachineSpec, ground: Ground) -> None:
        """
        Args:
            description: the machine.
            ground: what the shoes touch; its contact surface is read at each step.
        """
        self.spec = with_dynamic_tracks(spec)
        shape = self.spec.tracks
        count, hull = shape.shoe_count, hull_corners(spec)
        self.command: Array = np.zeros(2)
        self.travel: Array = np.zeros(2)
        self.speed: Array = np.zeros(2)
        self.shoe_poses: Array = np.array([initial_shoe_poses(shape)] * 2)
        self.shoe_loads: Array = np.zeros((2, count))
        self.sinkage: Array = np.zeros(2)
        self._mean_speeds: Array = np.zeros((2, 2))
        self.wrench: Array = np.zeros(6)
        self._ground = ground
        self._soil_patch = soil_patch_under(ground, shape.shoe_width)
        self._base_com = np.array(spec.links["base"].center_of_mass)
        self._dimensions = TrackDimensions(
            0.5 * shape.axle_distance,
            shape.sprocket_radius,
            0.5 * shape.gauge,
            0.5 * shape.shoe_width,
            0.5 * shape.shoe_thickness,
            shape.axle_height,
        )
        self._states: Array = np.zeros((2 * count, 13))
        self._forces: Array = np.zeros((2 * count, 6))
        self._brake_anchors: Array = np.full((2, count), math.nan)
        self._anchors: Array = np.zeros((8 * count, 3))
        self._active: NDArray[np.bool_] = np.zeros(8 * count, dtype=np.bool_)
        self._shear_displacement: Array = np.zeros(8 * count)
        self._path_deviations: Array = np.zeros(2)
        self._base_wrench: Array = np.zeros(6)
        self._hull = (hull, np.zeros((len(hull), 3)), np.zeros(len(hull), dtype=np.bool_))
        self._belt_speeds = [0.0, 0.0]  # the speeds that the belts are driven with [m/s]
        self._angles = [0.0, 0.0]  # references of the sprockets [rad]
        self._rates = [0.0, 0.0]  # [rad/s]
        self._tensioning_time_left = _TENSION_TIME

    @property
    def slip(self) -> Array:
        """See `Tracks`."""
        return track_slip(self._mean_speeds)

    @property
    def shoes_in_contact(self) -> int:
        """Number of shoes that carry load."""
        return int(np.count_nonzero(self.shoe_loads))

    def urdf(self) -> str:
        """URDF of the machine with sprockets and idlers."""
        return urdf_with_running_gear(self.spec)

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Lay the chains round the wheels and tighten them; arguments as in `Tracks`."""
        self._client, self._body = client, body
        joints = range(pybullet.getNumJoints(body, client))
        numbers = {pybullet.getJointInfo(body, i, client)[1].decode(): i for i in joints}
        self._sprockets = [numbers[f"sprocket_{side}"] for side in SIDES]
        self._idlers = [numbers[f"idler_{side}"] for side in SIDES]
        shape = self.spec.tracks
        self._chains = ShoeChains(client, body, shape, position, rotation)
        for idler in self._idlers:
            pybullet.setJointMotorControl2(
                body, idler, pybullet.VELOCITY_CONTROL, targetVelocity=0.1,
                force=_TENSION_FRACTION * shape.max_tractive_effort, physicsClientId=client,
            )  # fmt: skip

    def step(
        self,
        dt: float,
        com: Array,
        rotation: Array,
        velocity: Array,
        angular_velocity: Array,
        swing: float,
    ) -> Array:
        """Let ground and drive act on the shoes in the next step; see `Tracks`."""
        self._chains.read(self._states)
        if not np.isfinite(self._states).all():
            raise MachineError(
                "the tracks' motion is not finite any more; take a shorter time step"
            )
        supports, contact_coefficients = self._support_and_contact(dt)
        dynamic_track_step(
            dt,
            com,
            rotation,
            velocity,
            angular_velocity,
            self._base_com,
            self._dimensions,
            supports,
            contact_coefficients,
            (self._belt_speeds[0] == 0.0, self._belt_speeds[1] == 0.0),
            self._soil_patch,
            self._states,
            self._brake_anchors,
            self._anchors,
            self._active,
            self._shear_displacement,
            self._forces,
            self.shoe_poses,
            self.shoe_loads,
            self.sinkage,
            self._mean_speeds,
            self.speed,
            self._path_deviations,
            self._base_wrench,
            self.wrench,
        )
        self._check_shoes_on_path()
        hull, anchors, active = self._hull
        on_hull = np.zeros(6)
        add_hull_contact(
            com,
            rotation,
            velocity,
            angular_velocity,
            self._base_com,
            hull,
            math.cos(swing),
            math.sin(swing),
            contact_coefficients,
            self._ground.surface,
            self._ground.frame,
            anchors,
            active,
            0,
            on_hull,
        )
        self.wrench += on_hull
        shape = self.spec.tracks
        self.travel = (self.travel + self.speed * dt) % (shape.shoe_count * shape.sprocket_radius)
        self._chains.apply_forces(self._forces, self._states[:, :3])
        self._drive(dt)
        self._lock_idlers(dt)
        return self._base_wrench + on_hull

    def _support_and_contact(
        self, dt: float
    ) -> tuple[UndercarriageSupport, tuple[float, float, float, float, float]]:
        """The undercarriage's springs, and the laws of one of the four contact points of a shoe."""
        shape = self.spec.tracks
        mass = shape.belt_mass / shape.shoe_count
        stiffest, most = _MAX_STIFFNESS_FACTOR * mass / dt**2, _MAX_DAMPING_FACTOR * mass / dt
        stiffness = min(shape.normal_stiffness, stiffest)
        damping = min(shape.normal_damping, most)
        supports = UndercarriageSupport(
            stiffness,
            most,
            2.0 * stiffness,
            most,
            2.0 * shape.max_tractive_effort / (shape.shoe_count - NUM_SPROCKET_FLATS),
            shape.normal_damping - damping,
        )
        contact_coefficients = (
            0.25 * stiffness,
            0.25 * damping,
            0.25 * min(shape.tangential_stiffness, stiffest),
            0.25 * min(shape.tangential_damping, 0.75 * most),
            shape.friction,
        )
        return supports, contact_coefficients

    def _drive(self, dt: float) -> None:
        """Turn the sprockets so that the belts run as commanded; zero brakes and holds."""
        shape = self.spec.tracks
        sprockets = pybullet.getJointStates(self._body, self._sprockets, self._client)
        for k, (angle, *_) in enumerate(sprockets):
            wanted, pace = float(self.command[k]), self._belt_speeds[k]
            slower = wanted * pace <= 0.0 or abs(wanted) < abs(pace)
            most = (
                shape.max_deceleration
                if slower
                else min(shape.max_acceleration, _MAX_BELT_ACCELERATION)
            ) * dt
            pace = min(max(wanted, pace - most), pace + most)
            # A corner takes the chain along; right below the axle it moves the way the chain does.
            off = (
                angle + 0.5 * SPROCKET_CORNER_ANGLE
            ) % SPROCKET_CORNER_ANGLE - 0.5 * SPROCKET_CORNER_ANGLE
            rate = pace / (shape.sprocket_radius * math.cos(off))
            target = self._angles[k] + rate * dt
            self._angles[k] = min(
                max(target, angle - _MAX_REFERENCE_LEAD), angle + _MAX_REFERENCE_LEAD
            )
            self._belt_speeds[k], self._rates[k] = pace, rate
        torque = shape.max_tractive_effort * shape.sprocket_radius
        pybullet.setJointMotorControlArray(
            self._body,
            self._sprockets,
            pybullet.POSITION_CONTROL,
            self._angles,
            self._rates,
            [torque if pace else _BRAKED_TORQUE_FRACTION * torque for pace in self._belt_speeds],
            [_SPROCKET_GAIN] * 2,
            [1.0] * 2,
            physicsClientId=self._client,
        )

    def _lock_idlers(self, dt: float) -> None:
        """Lock the idlers once the chains have been tightened for long enough."""
        if self._tensioning_time_left <= 0.0:
            return
        self._tensioning_time_left -= dt
        if self._tensioning_time_left <= 0.0:
            force = _IDLER_LOCK_FORCE_FACTOR * self.spec.tracks.max_tractive_effort
            for idler in self._idlers:
                pybullet.setJointMotorControl2(
                    self._body, idler, pybullet.POSITION_CONTROL, targetPosition=_IDLER_LOCK_POSITION,
                    positionGain=0.2, velocityGain=1.0, force=force, physicsClientId=self._client,
                )  # fmt: skip

    def _check_shoes_on_path(self) -> None:
        """See that the shoes are where a track has them.

        Raises:
            MachineError: one is not.
        """
        limit = _MAX_PATH_DEVIATION * self.spec.tracks.sprocket_radius
        for side, stray in zip(SIDES, self._path_deviations.tolist(), strict=True):
            if stray > limit:
                raise MachineError(
                    f"the {side} track has come off its wheels: a shoe is {stray:.2f} m from its"
                    " path. Drive more gently, take a shorter time step, or use track_model: kinematic"
                )

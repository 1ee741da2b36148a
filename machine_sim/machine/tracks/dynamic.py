"""Dynamic tracks: rigid shoes hinged to each other and driven by the friction of the rear sprocket.

The shoes are bodies in pybullet (`shoe_chain`), sprockets and idlers are joints of the machine's
multibody (`running_gear`). The forces of the ground, which is the machine's own copy of the
terrain, and of the undercarriage on the shoes are computed before each step (`dynamic_step`).
"""

from __future__ import annotations

import math

import numpy as np

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.actuator_step import actuator_step
from machine_sim.machine.base_motion import (
    ANGULAR_VELOCITY,
    CENTER_OF_MASS,
    ROTATION,
    VELOCITY,
)
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import BASE, MachineSpec
from machine_sim.machine.tracks.axle_contact import axle_coefficients
from machine_sim.machine.tracks.axle_support import NUM_AXLE_POINTS, AxleSupport
from machine_sim.machine.tracks.body_contact import body_contact
from machine_sim.machine.tracks.dynamic_step import (
    POINTS_PER_SHOE,
    ShoeBodies,
    dynamic_track_step,
)
from machine_sim.machine.tracks.running_gear import (
    NUM_SPROCKET_FLATS,
    SIDES,
    SPROCKET_CORNER_ANGLE,
    initial_shoe_poses,
    urdf_with_running_gear,
    with_dynamic_tracks,
)
from machine_sim.machine.tracks.shoe_chain import (
    SHOE_POSITION,
    SHOE_QUATERNION,
    SHOE_STATE_SIZE,
    ShoeChains,
)
from machine_sim.machine.tracks.track_base import Array, TrackBase
from machine_sim.machine.tracks.track_state import ContactCoefficients, ContactPoints
from machine_sim.machine.tracks.undercarriage import UndercarriageSupport
from machine_sim.physics_engine import pybullet
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.kernels import BoxedTable

__all__ = ["DynamicTracks"]

_MAX_STIFF_AXLE_LOAD = 0.3
"""Load up to which the ground below an axle is stiff, see `axle_coefficients`."""

_MAX_STIFF_RAIL_LOAD = 0.05
"""Maximum load of a contact point of a sole below the rail on rigid ground, as a fraction of the
machine's weight; more is an impact at a step."""

_MAX_BELT_ACCELERATION = 2.0
"""Maximum acceleration of a belt [m/s^2]; above it the slack run buckles."""

_TENSION_FRACTION, _TENSION_TIME = 0.55, 1.0
"""Tension of a new chain as a fraction of the tractive effort, and time to tighten it [s]."""

_IDLER_LOCK_POSITION, _IDLER_LOCK_FORCE_FACTOR = 0.02, 5.5
"""Position at which the idler is locked after that [m], and its maximum force as a multiple of the
tractive effort."""

_MAX_REFERENCE_LEAD = 0.02
"""Maximum distance of a sprocket's reference from its angle [rad]; it prevents wind-up."""

_BRAKED_TORQUE_FRACTION = 0.015
"""Fraction of its torque that a sprocket keeps while the brake holds the chain. A larger torque
against the brake would be released in jerks that move the machine."""

_SPROCKET_GAIN = 0.2
"""Fraction of a sprocket's angle error that is corrected in one step."""

_MAX_PATH_DEVIATION = 0.8
"""Distance from its path at which a chain has come off, in sprocket radii; see
`chain_deviation`."""

_MAX_STIFFNESS_FACTOR, _MAX_DAMPING_FACTOR = 0.27, 0.36
"""Bounds of a spring in mass / step^2 and of a damper in mass / step; above them a shoe, which is
light compared with its load, oscillates from step to step."""


class DynamicTracks(TrackBase):
    """Tracks of rigid shoes in the physics engine; attributes as in `Tracks`."""

    def __init__(self, spec: MachineSpec, ground: Ground) -> None:
        """
        Args:
            spec: specification of the machine.
            ground: terrain under the tracks; its contact surface is read at each step.
        """
        super().__init__(with_dynamic_tracks(spec), ground, POINTS_PER_SHOE)
        tracks = self.spec.tracks
        count = tracks.shoe_count
        self.shoe_poses[:] = initial_shoe_poses(tracks)
        self._bodies = ShoeBodies(
            states=np.zeros((2 * count, SHOE_STATE_SIZE)),
            brake_anchors=np.full((2, count), math.nan),
            forces=np.zeros((2 * count, 6)),
            path_deviations=np.zeros(2),
        )
        self._rail_coefficients = tuple(  # four contact points share those of the shoe
            ContactCoefficients(
                normal_stiffness=0.25 * tracks.normal_stiffness,
                normal_damping=0.25 * tracks.normal_damping,
                tangential_stiffness=0.25 * tracks.tangential_stiffness,
                tangential_damping=0.25 * tracks.tangential_damping,
                friction=tracks.friction,
                max_stiff_load=_MAX_STIFF_RAIL_LOAD * spec.mass * GRAVITY,
                residual_stiffness=0.0,
            )
        )
        self._axle_contacts = ContactPoints.inactive(NUM_AXLE_POINTS)
        load = 0.5 * spec.mass * GRAVITY * tracks.sprocket_radius / tracks.axle_distance
        self._axle_support = tuple(
            AxleSupport(
                clearance=load / tracks.normal_stiffness,
                coefficients=tuple(axle_coefficients(self.spec, _MAX_STIFF_AXLE_LOAD)),
                points=tuple(self._axle_contacts),
            )
        )
        self._base_wrench: Array = np.zeros(6)
        self._body_wrench: Array = np.zeros(6)
        self._belt_speeds = [0.0, 0.0]  # reference speeds of the belts [m/s]
        self._sprocket_angles = [0.0, 0.0]  # reference angles of the sprockets [rad]
        self._sprocket_rates = [0.0, 0.0]  # [rad/s]
        self._tensioning_time_left = [0.0, 0.0]

    def urdf(self) -> str:
        """Return the URDF of the machine with sprockets and idlers."""
        return urdf_with_running_gear(self.spec)

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Create the chains around the wheels and tighten them; arguments as in `Tracks`."""
        self._client, self._body = client, body
        joints = range(pybullet.getNumJoints(body, client))
        ids = {pybullet.getJointInfo(body, i, client)[1].decode(): i for i in joints}
        self._sprockets = [ids[f"sprocket_{side}"] for side in SIDES]
        self._idlers = [ids[f"idler_{side}"] for side in SIDES]
        self._chains = ShoeChains(client, body, self.spec.tracks, position, rotation)
        for side in range(len(SIDES)):
            self._tighten(side)

    def step(
        self,
        dt: float,
        motion: Array,
        swing: float,
        actuators: BoxedTable,
    ) -> list[float]:
        """Apply the forces of ground, undercarriage and drive in the next step; see `Tracks`."""
        actuator_step(dt, actuators)
        bodies = self._bodies
        # Before the forces are found: those on a chain that has come off would act on the new one.
        self._reseat_chains(motion)
        self._chains.read(bodies.states)
        if not np.isfinite(bodies.states).all():
            raise MachineError("the motion of the tracks is not finite; take a shorter time step")
        supports, coefficients = self._step_coefficients(dt)
        dimensions = tuple(self._dimensions)
        dynamic_track_step(
            dt,
            motion,
            dimensions,
            tuple(supports),
            tuple(coefficients),
            self._rail_coefficients,
            tuple(self._soil),
            tuple(self._shoe_contacts),
            self._axle_support,
            (self._belt_speeds[0] == 0.0, self._belt_speeds[1] == 0.0),
            tuple(bodies),
            self._base_wrench,
            tuple(self._state),
        )
        body_contact(
            motion,
            (math.cos(swing), math.sin(swing)),
            dimensions,
            tuple(self._main_body),
            tuple(coefficients),
            self._body_wrench,
        )
        self.wrench += self._body_wrench
        tracks = self.spec.tracks
        length = tracks.shoe_count * tracks.sprocket_radius
        self.travel[:] = (self.travel + self.speed * dt) % length
        self._chains.apply_forces(bodies.forces, bodies.states[:, SHOE_POSITION:SHOE_QUATERNION])
        self._drive(dt)
        self._lock_idlers(dt)
        wrench: list[float] = (self._base_wrench + self._body_wrench).tolist()
        return wrench

    def _step_coefficients(self, dt: float) -> tuple[UndercarriageSupport, ContactCoefficients]:
        """Return the springs and dampers of a shoe on the undercarriage and at a contact point.

        They are limited by what is stable with a time step `dt` [s].
        """
        tracks = self.spec.tracks
        mass = tracks.belt_mass / tracks.shoe_count
        max_stiffness, max_damping = (
            _MAX_STIFFNESS_FACTOR * mass / dt**2,
            _MAX_DAMPING_FACTOR * mass / dt,
        )
        stiffness = min(tracks.normal_stiffness, max_stiffness)
        damping = min(tracks.normal_damping, max_damping)
        num_braked_shoes = tracks.shoe_count - NUM_SPROCKET_FLATS
        supports = UndercarriageSupport(
            stiffness=stiffness,
            damping=max_damping,
            rail_stiffness=2.0 * stiffness,
            rail_damping=max_damping,
            max_brake_force=2.0 * tracks.max_tractive_effort / num_braked_shoes,
        )
        coefficients = ContactCoefficients(  # four contact points share those of the shoe
            normal_stiffness=0.25 * stiffness,
            normal_damping=0.25 * damping,
            tangential_stiffness=0.25 * min(tracks.tangential_stiffness, max_stiffness),
            tangential_damping=0.25 * min(tracks.tangential_damping, 0.75 * max_damping),
            friction=tracks.friction,
        )
        return supports, coefficients

    def _drive(self, dt: float) -> None:
        """Drive the sprockets so that the belts follow the command; zero brakes and holds."""
        tracks = self.spec.tracks
        states = pybullet.getJointStates(self._body, self._sprockets, self._client)
        for side, (angle, _, _, torque) in enumerate(states):
            self.drive_forces[side] = torque / tracks.sprocket_radius
            speed = self._next_belt_speed(side, dt)
            # A corner moves the chain; below the axle it moves in the direction of the chain.
            corner_angle = (
                angle + 0.5 * SPROCKET_CORNER_ANGLE
            ) % SPROCKET_CORNER_ANGLE - 0.5 * SPROCKET_CORNER_ANGLE
            rate = speed / (tracks.sprocket_radius * math.cos(corner_angle))
            reference = self._sprocket_angles[side] + rate * dt
            self._sprocket_angles[side] = min(
                max(reference, angle - _MAX_REFERENCE_LEAD), angle + _MAX_REFERENCE_LEAD
            )
            self._belt_speeds[side], self._sprocket_rates[side] = speed, rate
        max_torque = tracks.max_tractive_effort * tracks.sprocket_radius
        pybullet.setJointMotorControlArray(
            self._body,
            self._sprockets,
            pybullet.POSITION_CONTROL,
            self._sprocket_angles,
            self._sprocket_rates,
            [
                max_torque if speed else _BRAKED_TORQUE_FRACTION * max_torque
                for speed in self._belt_speeds
            ],
            [_SPROCKET_GAIN] * 2,
            [1.0] * 2,
            physicsClientId=self._client,
        )

    def _next_belt_speed(self, side: int, dt: float) -> float:
        """Return the reference speed of a belt [m/s] after a step toward the command."""
        tracks = self.spec.tracks
        target, speed = float(self.command[side]), self._belt_speeds[side]
        is_braking = target * speed <= 0.0 or abs(target) < abs(speed)
        acceleration = (
            tracks.max_deceleration
            if is_braking
            else min(tracks.max_acceleration, _MAX_BELT_ACCELERATION)
        )
        return min(max(target, speed - acceleration * dt), speed + acceleration * dt)

    def _lock_idlers(self, dt: float) -> None:
        """Lock the idlers of the sides whose time to tighten the chain has elapsed."""
        force = _IDLER_LOCK_FORCE_FACTOR * self.spec.tracks.max_tractive_effort
        for side, time_left in enumerate(self._tensioning_time_left):
            if time_left <= 0.0:
                continue
            self._tensioning_time_left[side] = time_left - dt
            if time_left <= dt:
                pybullet.setJointMotorControl2(
                    self._body,
                    self._idlers[side],
                    pybullet.POSITION_CONTROL,
                    targetPosition=_IDLER_LOCK_POSITION,
                    positionGain=0.2,
                    velocityGain=1.0,
                    force=force,
                    physicsClientId=self._client,
                )

    def _reseat_chains(self, motion: Array) -> None:
        """Put a chain that has come off back around its wheels, without tension.

        It is at rest relative to the base.

        Args:
            motion: packed motion of the base, see `base_motion`.
        """
        limit = _MAX_PATH_DEVIATION * self.spec.tracks.sprocket_radius
        rotation, com = motion[ROTATION], motion[CENTER_OF_MASS]
        velocity, angular_velocity = motion[VELOCITY], motion[ANGULAR_VELOCITY]
        for side, deviation in enumerate(self._bodies.path_deviations.tolist()):
            if not deviation > limit:
                continue
            arm = rotation @ np.array(self.spec.links[BASE].center_of_mass)
            origin_velocity = velocity - np.cross(angular_velocity, arm)
            self._chains.place(side, com - arm, rotation, origin_velocity, angular_velocity)
            for joint in (self._sprockets[side], self._idlers[side]):
                pybullet.resetJointState(self._body, joint, 0.0, 0.0, physicsClientId=self._client)
            self._bodies.brake_anchors[side] = math.nan
            self._shoe_contacts.release(side)
            self._axle_contacts.release(side)
            self._tighten(side)
            self.num_reseats[side] += 1

    def _tighten(self, side: int) -> None:
        """Begin to push the idler of a side forward."""
        self._tensioning_time_left[side] = _TENSION_TIME
        pybullet.setJointMotorControl2(
            self._body,
            self._idlers[side],
            pybullet.VELOCITY_CONTROL,
            targetVelocity=0.1,
            force=_TENSION_FRACTION * self.spec.tracks.max_tractive_effort,
            physicsClientId=self._client,
        )

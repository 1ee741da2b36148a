"""Milling resistance: the work of a drum in the soil, and the thrust out of the face.

With each tick the drum reports the work that it can deliver: what its drive delivers in a tick at
the present speed, and a part of the kinetic energy above that of its loaded speed. The soil removes
no more than this work covers, and answers, one or two ticks later, with the work that it took. That
work is a debt, which the picks take out of the drum during the next tick. A drum that falls below
its loaded speed, or whose debt is not paid, reports less. The debt closes the balance of energy:

    work of drive and feed = increase of kinetic energy + milling + work against particles

The soil in front of the drum bears it like any tool (`capped_spring_damper`): soil that is removed
at once with the thrust on the picks, their cutting force times a ratio; soil that the work did not
suffice to remove with its strength, so that the feed stalls. Conversely picks that are pressed
against the soil with a force cut with that force over the ratio; they reach the depth of that force
after the drum has turned by the angle between two rows of picks. If the torque is beyond that of
the drive, the drum slows down and stalls until the feed is reduced. Work of the picks beyond the
debt is kept for the next ticks.

The force on the picks is against their motion over the soil, by the spin and the motion of the
drum, and is limited to what stops them in a step. A drum that is not driven is supported by the
soil like any other tool (`machine_sim.tool_soil.resistance`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError, Tool
from machine_sim.machine.box import Vec3
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.machine.tools.tool import MIN_DRUM_SPEED
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.capped_spring_damper import norm
from machine_sim.tool_soil.resistance import (
    FORCE_TIMEOUT_TICKS,
    SoilResistance,
    machine_contact,
)
from msg_bridge.contract.rows import FORCE_VECTORS, Rows, SoilReaction

__all__ = ["MillingResistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

_ZERO = (0.0, 0.0, 0.0)

_THRUST_RATIO = 1.0
"""Ratio of the normal to the cutting force of a pick [-]: measured ratios of conical picks are
around one and increase with wear (see `soil_sim.tool_force.rock_pick`)."""

_LOADED_SPEED_FRACTION = 0.95
"""Speed of the drum at full load as a fraction of the commanded one [-], typical of the slip of an
induction motor."""

_ENERGY_GAIN = 0.3
"""Fraction of the difference to the kinetic energy at the loaded speed that a tick may use. An
answer lags by up to three ticks; the speed oscillates above 2 sin(pi / 14) = 0.45."""

_STORE_TICKS = 10.0
"""Maximum work of the picks beyond the debt that is kept, in ticks of the drive's work."""

_STOPPING_FRACTION = 0.7
"""Maximum fraction of its velocity over the soil that a drum without drive loses in a step."""

_MIN_LEVER_FRACTION = 0.3
"""Minimum lever arm of the picks as a fraction of the drum's radius: picks engage on its rim, but
the centre of the engaged soil can be on the axis."""

_MILL, _BEARING = int(SoilReaction.MILL), int(SoilReaction.BEARING)


class MillingResistance:
    """Resistance of the soil to one drum.

    Attributes:
        static_resistance: resistance while the drum is not driven.
        contact: force of the soil in front of a driven drum.
        debt: work that milled soil has taken and the picks have yet to take out of the drum [J];
            negative: work of the picks that no soil has taken yet.
    """

    def __init__(
        self, tool: Tool, shape: DrumShape, machine_mass: float, params: MachineSimParams
    ) -> None:
        """
        Args:
            tool: the drum.
            shape: its shape.
            machine_mass: mass of the whole machine [kg].
            params: stepping of the node.
        """
        self._tool, self._radius = tool, shape.radius
        self._pick_angle = 2.0 * math.pi / shape.vanes
        self._tick_period = params.tick_period
        self.static_resistance = SoilResistance(tool.mass, machine_mass, params.physics_step)
        self.contact = machine_contact(machine_mass, params.physics_step)
        self._ticks_since_update = 0
        self.debt = 0.0
        self._power = 0.0  # at which the debt is paid in this tick [W]
        self._picks = _Picks(_ZERO, shape.radius, _ZERO)  # in the last step
        self._force = self._last_slip = 0.0  # of these picks [N], [m/s]
        self._pressed_force = 0.0  # of picks that are pressed into the soil [N]

    @property
    def is_active(self) -> bool:
        """Whether soil resists or supports the drum."""
        return (
            self.contact.max_force > 0.0
            or self.debt > 0.0
            or self._force > 0.0
            or self.static_resistance.is_active
        )

    @property
    def inflow_fraction(self) -> float:
        """Return 1: a drum has no room that could fill up."""
        return 1.0

    @property
    def deliverable_work(self) -> float:
        """Work that the drum can deliver to the soil in a tick [J]."""
        speed, commanded = self._tool.drum_speed, self._tool.commanded_drum_speed
        if abs(speed) < MIN_DRUM_SPEED:
            return 0.0
        loaded_speed = _LOADED_SPEED_FRACTION * abs(commanded) if self._is_driving else 0.0
        surplus = 0.5 * self._tool.inertia * (speed**2 - loaded_speed**2)
        return max(self._drive_work + _ENERGY_GAIN * surplus - self.debt, 0.0)

    @property
    def state(self) -> Array:
        """All values that the next steps depend on, for the state hash."""
        work = (self.debt, self._power, self._force, self._last_slip, self._pressed_force)
        parts = (
            self.contact.local_point,
            work,
            [self._ticks_since_update],
            self.contact.state,
            self.static_resistance.state,
        )
        return np.concatenate(parts)

    @property
    def _is_driving(self) -> bool:
        """Whether the drive is commanded in the direction in which the drum spins."""
        return self._tool.drum_speed * self._tool.commanded_drum_speed > 0.0

    @property
    def _max_store(self) -> float:
        """Maximum work of the picks beyond the debt that is kept [J]."""
        speed = max(abs(self._tool.drum_speed), abs(self._tool.commanded_drum_speed))
        return _STORE_TICKS * self._tool.drum_torque * speed * self._tick_period

    @property
    def _drive_work(self) -> float:
        """Work of the drive in a tick at the present speed and its maximum torque [J]."""
        if not self._is_driving:
            return 0.0
        return self._tool.drum_torque * abs(self._tool.drum_speed) * self._tick_period

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the drum's non-spinning frame at the end of that tick.

        Raises:
            MachineError: values that are not finite; the previous ones stay in force.
        """
        reactions = rows["reaction"].tolist()
        if _MILL not in reactions:
            self.static_resistance.receive(rows, pose)
            self._ticks_since_update = 0
            self.contact.reset()
            return
        milling = rows[reactions.index(_MILL) :][:1]
        point, force = _point_and_force(milling)
        work = float(milling["work"][0])
        if not (math.isfinite(work) and work >= 0.0):
            raise MachineError(f"the work of the drum is {work} J; give a finite number, 0 or more")
        limit = self._thrust(work)
        if _BEARING in reactions:
            point, force = _point_and_force(rows[reactions.index(_BEARING) :][:1])
            limit = math.inf
        self._ticks_since_update = 0
        self.static_resistance.reset()
        self.debt += work
        strength = norm(force)
        limit = min(limit, strength)
        if limit <= 0.0:
            self.contact.reset()
            return
        self.contact.set_wrench((point, limit / strength * force, np.zeros(3)), pose)

    def _thrust(self, work: float) -> float:
        """Return the thrust on picks that do some work in a tick [N]."""
        distance = self._radius * abs(self._tool.drum_speed) * self._tick_period
        return _THRUST_RATIO * work / distance if distance > 0.0 else 0.0

    def begin_tick(self) -> None:
        """Begin a tick: remove a wrench that was not updated for `FORCE_TIMEOUT_TICKS`."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            self.contact.reset()
        self.static_resistance.begin_tick()
        self._power = max(self.debt, 0.0) / self._tick_period

    def reset(self) -> None:
        """Remove all wrenches until the next FORCE rows."""
        self.static_resistance.reset()
        self.contact.reset()

    def step(
        self, pose: Pose, velocity: tuple[Vec3, Vec3], dt: float, push: Vec3 = (0.0, 0.0, 0.0)
    ) -> tuple[Vec3, Vec3]:
        """Return the wrench of the next physics step.

        Args:
            pose: of the drum's non-spinning frame.
            velocity: of its origin [m/s], and angular of the drum [rad/s], map axes.
            dt: physics step [s].
            push: has no effect: a drum holds no soil.

        Returns:
            Force [N] and torque about the frame's origin [N m], map axes.
        """
        (_, ax, _), (_, ay, _), (_, az, _) = pose[0].tolist()
        axis, (wx, wy, wz) = (ax, ay, az), velocity[1]
        spin = _dot(velocity[1], axis)
        frame_velocity = velocity[0], (wx - spin * ax, wy - spin * ay, wz - spin * az)
        # The work of the step that has ended: force times the mean of the slips at its ends.
        slip = self._picks.slip(spin, frame_velocity)
        self.debt -= self._force * 0.5 * abs(slip + self._last_slip) * dt
        self.debt = max(self.debt, -self._max_store)
        (fx, fy, fz), (tx, ty, tz) = _ZERO, _ZERO
        if self.static_resistance.is_active:
            (fx, fy, fz), (tx, ty, tz) = self.static_resistance.step(pose, frame_velocity, dt)
        contact = self.contact.step(pose, frame_velocity, dt)
        point: Vec3 = tuple((pose[0] @ self.contact.local_point).tolist())
        self._picks = picks = _Picks.at(point, axis, self._radius)
        self._last_slip = slip = picks.slip(spin, frame_velocity)
        target = self.contact.active_fraction * self.contact.max_force / _THRUST_RATIO
        travel = abs(slip) * dt / (picks.arm * self._pick_angle)
        rise = max(target - self._pressed_force, 0.0) * min(travel, 1.0)
        self._pressed_force = min(self._pressed_force + rise, target)
        self._force = self._cutting_force(slip, picks.arm, dt)
        # The cutting force is against the slip. On a lever below the minimum arm it has less than
        # its torque; the rest is a pure torque.
        against_slip = -math.copysign(self._force, slip)
        cx, cy, cz = (against_slip * component for component in picks.direction)
        mx, my, mz = moment = _cross(picks.point, (cx, cy, cz))
        rest = -math.copysign(self._force * picks.arm, slip) - _dot(moment, axis)
        return (
            (fx + contact[0] + cx, fy + contact[1] + cy, fz + contact[2] + cz),
            (
                tx + contact[3] + mx + rest * ax,
                ty + contact[4] + my + rest * ay,
                tz + contact[5] + mz + rest * az,
            ),
        )

    def _cutting_force(self, slip: float, arm: float, dt: float) -> float:
        """Return the force on the picks in the next step, 0 or more [N].

        Args:
            slip: velocity of the picks over the soil [m/s].
            arm: their lever arm about the axis [m].
            dt: physics step [s].
        """
        if slip == 0.0:
            return 0.0
        debt_force = min(self._power, max(self.debt, 0.0) / dt) / abs(slip)
        stopping_force = _STOPPING_FRACTION * self._tool.inertia / arm**2 * abs(slip) / dt
        if slip * self._tool.commanded_drum_speed > 0.0:
            stopping_force += self._tool.drum_torque / arm
        return min(max(debt_force, self._pressed_force), stopping_force)


class _Picks(NamedTuple):
    """Picks that engage soil.

    Attributes:
        point: where they do [m], relative to the origin of the frame, map axes.
        arm: lever arm about the axis [m].
        direction: of their motion when the drum spins with a positive speed, map axes.
    """

    point: Vec3
    arm: float
    direction: Vec3

    @classmethod
    def at(cls, point: Vec3, axis: Vec3, radius: float) -> _Picks:
        """Return the picks at a point of a drum with an axis and a radius [m]."""
        along = _dot(point, axis)
        (x, y, z), (ax, ay, az) = point, axis
        lever = x - along * ax, y - along * ay, z - along * az
        distance = math.sqrt(_dot(lever, lever))
        arm = max(distance, _MIN_LEVER_FRACTION * radius)
        if distance == 0.0:
            return cls(point, arm, _ZERO)
        dx, dy, dz = _cross(axis, lever)
        return cls(point, arm, (dx / distance, dy / distance, dz / distance))

    def slip(self, spin: float, frame_velocity: tuple[Vec3, Vec3]) -> float:
        """Return the velocity of the picks over the soil [m/s].

        Args:
            spin: angular velocity of the drum about its axis [rad/s].
            frame_velocity: of its non-spinning frame: of the origin [m/s], angular [rad/s].
        """
        (vx, vy, vz), (wx, wy, wz) = frame_velocity[0], _cross(frame_velocity[1], self.point)
        return spin * self.arm + _dot((vx + wx, vy + wy, vz + wz), self.direction)


def _dot(a: Vec3, b: Vec3) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    """Return the cross product."""
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def _point_and_force(row: Rows) -> tuple[Array, Array]:
    """Return point and force of a FORCE row, shape (1,).

    Raises:
        MachineError: values that are not finite.
    """
    (point, force, _) = row.view(FORCE_VECTORS)["values"].astype(np.float64).reshape(3, 3)
    if not math.isfinite(sum(point.tolist()) + sum(force.tolist())):
        raise MachineError(f"the FORCE row of the drum is {row}; give finite numbers")
    return point, force

"""The soil as the tool feels it: it resists the cut, it bears the tool, and it never drives it.

The soil answers a tick with the most it holds the tool with, as that moved then; it comes a tick or
two later. There are two holds, each a wrench: what resists the cut, against the way the tool went,
and what bears it, square to the plates that touch the ground. The newest holds until the next; its
point is kept in the tool frame and moves with the tool.

Soil that does not give in pushes as hard as it is pushed. So the point is held as the tracks' shoes
are (`machine.tracks.contact`), by a spring and a damper against the force's direction,

    share * F = k x + c v,    0 <= share <= 1,

where v is the point's speed against F and x its way since the soil gave in last; while the soil
gives in, the share is 1 and x stays behind. A tool that the machine cannot push any further is
stalled: it stands, and the soil bears just what the machine pushes with. One that goes back is let
go. A force that is switched with the sign of v would shake the arm at every step instead.

What bears the tool is told whether the tool moves or not, but not while it is bounced off the
ground a little. What resists its cut is told only when it cuts: a tool at rest tells nothing about
the soil before it, and one that is pressed back a little neither. The soil answers zero, and what
held the tool still holds it. Either is let go once it is `_CLEAR` away from where the soil held it
last, or after `FORCE_TIMEOUT_TICKS` ticks without any answer.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from msg_bridge.contract.rows import FORCE, Rows, SoilReaction

__all__ = ["FORCE_TIMEOUT_TICKS", "CappedSpringDamper", "SoilResistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

FORCE_TIMEOUT_TICKS = 5
"""Ticks without an answer after which a wrench is gone."""

_FIELD_NAMES = FORCE.names or ()
_POINT_FIELDS, _FORCE_FIELDS, _TORQUE_FIELDS = (
    ("x", "y", "z"),
    ("fx", "fy", "fz"),
    ("tx", "ty", "tz"),
)

_RELEASE_DISTANCE = 0.05
"""Way [m] that a tool goes without resistance until it has left the soil: as far as soil springs
back under the force of a machine."""

_UPDATE_DISTANCE = 0.01
"""Way [m] within which the strongest answer counts: at a stall each tick goes another way."""

_TOOL_EFFECTIVE_MASS_FRACTION = 0.3
"""What a push at the lip moves at least, in parts of the tool's mass: it turns about its pin."""

_MACHINE_EFFECTIVE_MASS_FRACTION = 0.11
"""What the ground lifts under the tool, in parts of the machine's mass: it turns about its tracks,
about 1 / (1 + d^2 / r^2) for a tool d = 4 m from its middle and a radius of gyration r = 1.5 m."""

_STIFFNESS = 0.2
"""Of the spring, over m / dt^2; explicit steps are stable for k + 2 c < 4. Where the bucket's drive
gives way, less than `_BORNE` moves, and a bearing that is pushed hard may chatter."""

_DAMPING = 0.5
"""Of the damper, over m / dt."""


class CappedSpringDamper:
    """A wrench of the soil on a tool, and how much of it acts.

    Attributes:
        force, torque: the most it holds with [N], [N m] about the point, map axes.
        strength: of the force [N], 0 where there is none.
        place: of the point, when it was told, map frame [m].
        share: part of the force that acts.
        way: of the point against the force since the soil gave in last [m].
    """

    def __init__(self, stiffness: float, damping: float, slack: float) -> None:
        """
        Args:
            stiffness: of the spring [N/m].
            damping: of the damper [N s/m].
            lifted: way [m] that the point may go back and the soil is where it was.
        """
        self._stiffness, self._damping, self._slack = stiffness, damping, slack
        self._local_point: Array = np.zeros(3)  # in the tool frame
        self.reset()

    def reset(self) -> None:
        """Nothing holds until the next answer."""
        self.force: Array = np.zeros(3)
        self.torque: Array = np.zeros(3)
        self.contact_point: Array = np.zeros(3)
        self.max_force = self.active_fraction = self.displacement = 0.0

    @property
    def state(self) -> tuple[float, ...]:
        """All that the next steps depend on."""
        return (
            *self.force,
            *self.torque,
            *self.contact_point,
            *self._local_point,
            self.displacement,
        )

    def set_wrench(self, wrench: tuple[Array, Array, Array], pose: Pose) -> None:
        """Hold with another wrench from now on: place [m], force, torque of the soil on the tool.

        Args:
            wrench: map frame; the force is not zero.
            pose: of the tool frame when it was at the place.
        """
        self.contact_point, self.force, self.torque = wrench
        self.max_force = _norm(self.force)
        self._local_point = pose[0].T @ (self.contact_point - pose[1])

    def distance_to_contact(self, pose: Pose) -> float:
        """How far [m] the point is from its place."""
        return _norm(pose[0] @ self._local_point + pose[1] - self.contact_point)

    def step(self, pose: Pose, velocity: tuple[Array, Array], dt: float) -> tuple[float, ...]:
        """Force x, y, z [N] and torque about the tool frame's origin [N m] of the next step."""
        if self.max_force == 0.0:
            return (0.0,) * 6
        ax, ay, az = (pose[0] @ self._local_point).tolist()
        (vx, vy, vz), (wx, wy, wz) = velocity[0].tolist(), velocity[1].tolist()
        (fx, fy, fz), (tx, ty, tz) = self.force.tolist(), self.torque.tolist()
        # The point moves with v + w x a.
        vx, vy, vz = vx + (wy * az - wz * ay), vy + (wz * ax - wx * az), vz + (wx * ay - wy * ax)
        speed = -(vx * fx + vy * fy + vz * fz) / self.max_force
        self.displacement += speed * dt
        pushed = self._stiffness * self.displacement + self._damping * speed
        held = min(max(pushed, 0.0), self.max_force)
        if held == 0.0:  # it goes back
            self.displacement = min(max(self.displacement, -self._slack), 0.0)
        elif held != pushed:  # the soil gives in: the spring starts from where it is now
            self.displacement = min(self.displacement, held / self._stiffness)
        self.active_fraction = active_fraction = held / self.max_force
        fx, fy, fz = active_fraction * fx, active_fraction * fy, active_fraction * fz
        tx = active_fraction * tx + (ay * fz - az * fy)
        ty = active_fraction * ty + (az * fx - ax * fz)
        tz = active_fraction * tz + (ax * fy - ay * fx)
        return fx, fy, fz, tx, ty, tz


class SoilResistance:
    """What holds one tool.

    Attributes:
        cut: what resists its cut.
        bearing: what bears it.
    """

    def __init__(self, tool_mass: float, machine_mass: float, dt: float) -> None:
        """
        Args:
            tool_mass: of the tool's link [kg].
            machine_mass: of all of it [kg].
            dt: physics step [s].
        """
        self.cut = _spring_damper(_TOOL_EFFECTIVE_MASS_FRACTION * tool_mass, dt, 0.0)
        self.bearing = _spring_damper(
            _MACHINE_EFFECTIVE_MASS_FRACTION * machine_mass, dt, _RELEASE_DISTANCE
        )
        self._ticks_since_update = 0

    @property
    def is_active(self) -> bool:
        """Whether there is soil that resists or bears."""
        return self.cut.max_force > 0.0 or self.bearing.max_force > 0.0

    @property
    def state(self) -> Array:
        """All that the next steps depend on, for a digest."""
        return np.array(
            [*self.cut.state, *self.bearing.state, self._ticks_since_update], dtype=np.float64
        )

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the tool frame at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; what was known before stays.
        """
        wrenches = {}
        for row in rows.tolist():
            told = dict(zip(_FIELD_NAMES, row, strict=True))
            parts = [
                [told[name] for name in names]
                for names in (_POINT_FIELDS, _FORCE_FIELDS, _TORQUE_FIELDS)
            ]
            if not all(math.isfinite(value) for part in parts for value in part):
                raise MachineError(
                    f"the soil's wrench on the tool is {parts}; give finite metres, N and N m"
                )
            if any(parts[1]):
                contact_point, force, torque = map(np.array, parts)
                wrenches[told["reaction"]] = (contact_point, force, torque)
        self._ticks_since_update = 0
        self._receive_cut(wrenches.get(SoilReaction.CUT), pose)
        if SoilReaction.BEARING in wrenches:
            self.bearing.set_wrench(wrenches[SoilReaction.BEARING], pose)
        elif self.bearing.distance_to_contact(pose) > _RELEASE_DISTANCE:
            self.bearing.reset()

    def _receive_cut(self, wrench: tuple[Array, Array, Array] | None, pose: Pose) -> None:
        went = self.cut.distance_to_contact(pose)
        if wrench is None:
            if went > _RELEASE_DISTANCE:
                self.cut.reset()
            return
        if _norm(wrench[1]) >= self.cut.max_force or went >= _UPDATE_DISTANCE:
            self.cut.set_wrench(wrench, pose)

    def begin_tick(self) -> None:
        """Begin a tick: a wrench that is no longer heard of lapses."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            self.reset()

    def reset(self) -> None:
        """No soil resists until the next answer."""
        self.cut.reset()
        self.bearing.reset()

    def step(self, pose: Pose, velocity: tuple[Array, Array], dt: float) -> tuple[Array, Array]:
        """The wrench of the next physics step.

        Args:
            pose: of the tool frame.
            velocity: of its origin [m/s], and angular [rad/s], map axes.
            dt: physics step [s].

        Returns:
            Force [N] on the tool and torque about its frame's origin [N m], map axes.
        """
        wrench = np.array(self.cut.step(pose, velocity, dt))
        wrench += self.bearing.step(pose, velocity, dt)
        return wrench[:3], wrench[3:]


def _spring_damper(mass: float, dt: float, slack: float) -> CappedSpringDamper:
    return CappedSpringDamper(_STIFFNESS * mass / dt**2, _DAMPING * mass / dt, slack)


def _norm(vector: Array) -> float:
    x, y, z = vector.tolist()
    return math.sqrt(x * x + y * y + z * z)

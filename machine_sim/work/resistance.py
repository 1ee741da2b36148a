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
last, or after `LAPSE` ticks without any answer.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from msg_bridge.contract.rows import FORCE, Holds, Rows

__all__ = ["LAPSE", "Hold", "Resistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

LAPSE = 5
"""Ticks without an answer after which a wrench is gone."""

_NAMES = FORCE.names or ()
_POINT, _FORCE, _TORQUE = ("x", "y", "z"), ("fx", "fy", "fz"), ("tx", "ty", "tz")

_CLEAR = 0.05
"""Way [m] that a tool goes without resistance until it has left the soil: as far as soil springs
back under the force of a machine."""

_NEAR = 0.01
"""Way [m] within which the strongest answer counts: at a stall each tick goes another way."""

_LIGHTEST = 0.3
"""What a push at the lip moves at least, in parts of the tool's mass: it turns about its pin."""

_BORNE = 0.11
"""What the ground lifts under the tool, in parts of the machine's mass: it turns about its tracks,
about 1 / (1 + d^2 / r^2) for a tool d = 4 m from its middle and a radius of gyration r = 1.5 m."""

_STIFFNESS = 0.2
"""Of the spring, over m / dt^2; explicit steps are stable for k + 2 c < 4. Where the bucket's drive
gives way, less than `_BORNE` moves, and a bearing that is pushed hard may chatter."""

_DAMPING = 0.5
"""Of the damper, over m / dt."""


class Hold:
    """A wrench of the soil on a tool, and how much of it acts.

    Attributes:
        force, torque: the most it holds with [N], [N m] about the point, map axes.
        strength: of the force [N], 0 where there is none.
        place: of the point, when it was told, map frame [m].
        share: part of the force that acts.
        way: of the point against the force since the soil gave in last [m].
    """

    def __init__(self, stiffness: float, damping: float, lifted: float) -> None:
        """
        Args:
            stiffness: of the spring [N/m].
            damping: of the damper [N s/m].
            lifted: way [m] that the point may go back and the soil is where it was.
        """
        self._stiffness, self._damping, self._lifted = stiffness, damping, lifted
        self._point: Array = np.zeros(3)  # in the tool frame
        self.forget()

    def forget(self) -> None:
        """Nothing holds until the next answer."""
        self.force: Array = np.zeros(3)
        self.torque: Array = np.zeros(3)
        self.place: Array = np.zeros(3)
        self.strength = self.share = self.way = 0.0

    @property
    def state(self) -> tuple[float, ...]:
        """All that the next steps depend on."""
        return (*self.force, *self.torque, *self.place, *self._point, self.way)

    def take(self, wrench: tuple[Array, Array, Array], pose: Pose) -> None:
        """Hold with another wrench from now on: place [m], force, torque of the soil on the tool.

        Args:
            wrench: map frame; the force is not zero.
            pose: of the tool frame when it was at the place.
        """
        self.place, self.force, self.torque = wrench
        self.strength = _length(self.force)
        self._point = pose[0].T @ (self.place - pose[1])

    def away(self, pose: Pose) -> float:
        """How far [m] the point is from its place."""
        return _length(pose[0] @ self._point + pose[1] - self.place)

    def step(self, pose: Pose, velocity: tuple[Array, Array], dt: float) -> tuple[float, ...]:
        """Force x, y, z [N] and torque about the tool frame's origin [N m] of the next step."""
        if self.strength == 0.0:
            return (0.0,) * 6
        ax, ay, az = (pose[0] @ self._point).tolist()
        (vx, vy, vz), (wx, wy, wz) = velocity[0].tolist(), velocity[1].tolist()
        (fx, fy, fz), (tx, ty, tz) = self.force.tolist(), self.torque.tolist()
        # The point moves with v + w x a.
        vx, vy, vz = vx + (wy * az - wz * ay), vy + (wz * ax - wx * az), vz + (wx * ay - wy * ax)
        speed = -(vx * fx + vy * fy + vz * fz) / self.strength
        self.way += speed * dt
        pushed = self._stiffness * self.way + self._damping * speed
        held = min(max(pushed, 0.0), self.strength)
        if held == 0.0:  # it goes back
            self.way = min(max(self.way, -self._lifted), 0.0)
        elif held != pushed:  # the soil gives in: the spring starts from where it is now
            self.way = min(self.way, held / self._stiffness)
        self.share = share = held / self.strength
        fx, fy, fz = share * fx, share * fy, share * fz
        tx = share * tx + (ay * fz - az * fy)
        ty = share * ty + (az * fx - ax * fz)
        tz = share * tz + (ax * fy - ay * fx)
        return fx, fy, fz, tx, ty, tz


class Resistance:
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
        self.cut = _hold(_LIGHTEST * tool_mass, dt, 0.0)
        self.bearing = _hold(_BORNE * machine_mass, dt, _CLEAR)
        self._age = 0

    @property
    def holds(self) -> bool:
        """Whether there is soil that resists or bears."""
        return self.cut.strength > 0.0 or self.bearing.strength > 0.0

    @property
    def state(self) -> Array:
        """All that the next steps depend on, for a digest."""
        return np.array([*self.cut.state, *self.bearing.state, self._age], dtype=np.float64)

    def hear(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the tool frame at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; what was known before stays.
        """
        wrenches = {}
        for row in rows.tolist():
            told = dict(zip(_NAMES, row, strict=True))
            parts = [[told[name] for name in names] for names in (_POINT, _FORCE, _TORQUE)]
            if not all(math.isfinite(value) for part in parts for value in part):
                raise MachineError(
                    f"the soil's wrench on the tool is {parts}; give finite metres, N and N m"
                )
            if any(parts[1]):
                place, force, torque = map(np.array, parts)
                wrenches[told["holds"]] = (place, force, torque)
        self._age = 0
        self._hear_cut(wrenches.get(Holds.CUT), pose)
        if Holds.BEARING in wrenches:
            self.bearing.take(wrenches[Holds.BEARING], pose)
        elif self.bearing.away(pose) > _CLEAR:
            self.bearing.forget()

    def _hear_cut(self, wrench: tuple[Array, Array, Array] | None, pose: Pose) -> None:
        went = self.cut.away(pose)
        if wrench is None:
            if went > _CLEAR:
                self.cut.forget()
            return
        if _length(wrench[1]) >= self.cut.strength or went >= _NEAR:
            self.cut.take(wrench, pose)

    def tick(self) -> None:
        """Begin a tick: a wrench that is no longer heard of lapses."""
        self._age += 1
        if self._age > LAPSE:
            self.forget()

    def forget(self) -> None:
        """No soil resists until the next answer."""
        self.cut.forget()
        self.bearing.forget()

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


def _hold(mass: float, dt: float, lifted: float) -> Hold:
    return Hold(_STIFFNESS * mass / dt**2, _DAMPING * mass / dt, lifted)


def _length(vector: Array) -> float:
    x, y, z = vector.tolist()
    return math.sqrt(x * x + y * y + z * z)

"""The cut as the tool feels it: the soil's wrench resists the tool's motion and never drives it.

The soil answers a tick with the wrench on the tool as it moved then; it comes a tick or two later.
The newest one holds until the next. Its point is kept in the tool frame and moves with the tool.

The wrench is what the soil resists with *at most*: soil that is not cut pushes as hard as it is
pushed. So the point is held as the tracks' shoes are (`machine.track_contact`), by a spring and a
damper against the force's direction,

    share * F = k x + c v,    0 <= share <= 1,

where v is the point's speed against F and x its way since the soil gave in last; while the tool
cuts, the share is 1 and x stays behind. A tool that the machine cannot push any further is
stalled: it stands, and the soil bears just what the machine pushes with. One that goes back is let
go. A force that is switched with the sign of v would shake the arm at every step instead.

A tool at rest tells nothing about the soil, and one that is pressed back a little neither: the soil
answers zero, and what held the tool still holds it. It is let go once it is `_CLEAR` away from
where the soil resisted last, or after `LAPSE` ticks without any answer.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from msg_bridge.contract.rows import Rows

__all__ = ["LAPSE", "Resistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

LAPSE = 5
"""Ticks without an answer after which a wrench is gone."""

_POINT, _FORCE, _TORQUE = ("x", "y", "z"), ("fx", "fy", "fz"), ("tx", "ty", "tz")

_CLEAR = 0.05
"""Way [m] that a tool goes without resistance until it has left the soil: as far as soil springs
back under the force of a machine."""

_NEAR = 0.01
"""Way [m] within which the strongest answer counts: at a stall each tick goes another way."""

_LIGHTEST = 0.3
"""What a push at the lip moves at least, in parts of the tool's mass: it turns about its pin."""

_STIFFNESS = 0.2
"""Of the spring, over m / dt^2; explicit steps are stable for k + 2 c < 4."""

_DAMPING = 0.5
"""Of the damper, over m / dt."""


class Resistance:
    """What resists one tool.

    Attributes:
        force, torque: the newest wrench of the soil, the most it resists with [N], [N m], map axes.
        share: part of it that acts.
    """

    def __init__(self, tool_mass: float, dt: float) -> None:
        """
        Args:
            tool_mass: of the tool's link [kg].
            dt: physics step [s].
        """
        mass = _LIGHTEST * tool_mass
        self._stiffness = _STIFFNESS * mass / dt**2
        self._damping = _DAMPING * mass / dt
        self.force: Array = np.zeros(3)
        self.torque: Array = np.zeros(3)
        self.share = 0.0
        self._strength = 0.0  # of the force [N]
        self._point: Array = np.zeros(3)  # in the tool frame
        self._place: Array = np.zeros(3)  # where it was when the soil resisted last, map frame
        self._way = 0.0
        self._age = 0

    @property
    def holds(self) -> bool:
        """Whether there is soil that resists."""
        return self._strength > 0.0

    def hear(self, row: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            row: FORCE row of the tool, a single one (shape ()).
            pose: of the tool frame at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; the one before stays.
        """
        named = {name: float(row[name]) for name in _POINT + _FORCE + _TORQUE}
        if not all(map(math.isfinite, named.values())):
            raise MachineError(
                f"the soil's wrench on the tool is {named}; give finite metres, N and N m"
            )
        self._age = 0
        force = np.array([named[name] for name in _FORCE])
        strength = math.sqrt(force @ force)
        away = pose[0] @ self._point + pose[1] - self._place
        went = math.sqrt(away @ away)
        if 0.0 < strength < self._strength and went < _NEAR:
            return
        if strength > 0.0:
            self.force, self._strength = force, strength
            self.torque = np.array([named[name] for name in _TORQUE])
            self._place = np.array([named[name] for name in _POINT])
            self._point = pose[0].T @ (self._place - pose[1])
        elif went > _CLEAR:
            self.forget()

    def tick(self) -> None:
        """Begin a tick: a wrench that is no longer heard of lapses."""
        self._age += 1
        if self._age > LAPSE:
            self.forget()

    def forget(self) -> None:
        """No soil resists until the next answer."""
        self.force, self.torque = np.zeros(3), np.zeros(3)
        self._strength = self.share = self._way = 0.0

    def step(self, pose: Pose, velocity: tuple[Array, Array], dt: float) -> tuple[Array, Array]:
        """The wrench of the next physics step.

        Args:
            pose: of the tool frame.
            velocity: of its origin [m/s], and angular [rad/s], map axes.
            dt: physics step [s].

        Returns:
            Force [N] on the tool and torque about its frame's origin [N m], map axes.
        """
        if not self.holds:
            return np.zeros(3), np.zeros(3)
        arm = pose[0] @ self._point
        speed = -float((velocity[0] + np.cross(velocity[1], arm)) @ self.force) / self._strength
        self._way += speed * dt
        pushed = self._stiffness * self._way + self._damping * speed
        held = min(max(pushed, 0.0), self._strength)
        if held != pushed:
            # The soil gives in, or the point goes back: the spring starts from where it is now.
            self._way = min(self._way, held / self._stiffness) if held > 0.0 else 0.0
        self.share = held / self._strength
        force = self.share * self.force
        return force, self.share * self.torque + np.cross(arm, force)
